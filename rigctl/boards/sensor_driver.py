"""A sensor of somebody else's board: the contract of its driver, and its bytes as our blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import LATE, MAX_JUMP, Flag
from rigctl.config.rig_config import RigConfig
from rigctl.errors import ConfigError, LinkLost
from rigctl.plugins import Lookup, Plugin
from rigctl.values import SAMPLE_RATE_HZ, TAXELS, Block, BoardIdentity, Gap

if TYPE_CHECKING:
    from rigctl.boards.taxel_decoder import Decoded


class Readings(NamedTuple):
    """The samples of some bytes, oldest first.

    ``counters``: int (n,), the board's number of each sample, as it was sent. ``samples``: uint16
    (n, n_taxels), from 0 to ``full_scale``. ``sync``: bool (n,), whether the drum's sync line was
    high; None of a board that does not read it. ``rejected_bytes``: those of no intact frame.
    """

    counters: NDArray[np.integer]
    samples: NDArray[np.uint16]
    sync: NDArray[np.bool_] | None = None
    rejected_bytes: int = 0


class Sensor(Protocol):
    """A sensor's stream: a class of which one object is made for each connection.

    The attributes are of the class. ``rate_hz``: 1000. ``full_scale``: the highest reading, at most
    65,535. ``counter_modulus``: of the board's sample number, at least 65,536, better 2**32.
    ``has_sync``: the board reads the drum's sync line. ``request``: what is sent every 0.1 s until
    the first sample comes, b"" for a board that needs none.
    """

    baud: int
    n_taxels: int
    rate_hz: int
    full_scale: int
    counter_modulus: int
    has_sync: bool
    request: bytes

    def decode(self, data: bytes) -> Readings:
        """Return the samples that these bytes complete; a stream is cut at any byte."""
        ...


class SimulatedSensor(Sensor, Protocol):
    """A sensor that can be rehearsed: without ``encode``, a simulated rig refuses it."""

    def encode(
        self, counters: NDArray[np.int64], samples: NDArray[np.uint16], sync: NDArray[np.bool_]
    ) -> bytes:
        """Return the bytes that the board would send for these samples."""
        ...


OUR_WIRE = "rigctl"
SENSORS: Lookup[type[Sensor] | None] = Lookup("sensor", {OUR_WIRE: None}, Sensor)
"""What ``[taxels] driver`` names; our own wire is that of ``docs/reference/taxel-wire.md``."""


@dataclass(frozen=True, slots=True)
class SensorDriver:
    """The driver that a rig names, and the package that it is from."""

    plugin: Plugin
    create: type[Sensor]

    @property
    def identity(self) -> BoardIdentity:
        """What stands for an identity, which no foreign board sends."""
        version = f"{self.plugin.package} {self.plugin.version}"
        return BoardIdentity(TAXELS, version, "", 0, 0, 0)


def load_sensor(config: RigConfig) -> SensorDriver | None:
    """Return the driver that ``[taxels]`` names, None for our own wire.

    Raises WrongUse for a plug-in that cannot be used, ConfigError where ``rig.toml`` describes
    another sensor than the driver.
    """
    taxels = config.taxels
    plugin, create = SENSORS.plugin(taxels.driver), SENSORS.load(taxels.driver)
    if plugin is None or create is None:
        return None
    wanted = {"count": create.n_taxels, "full_scale": create.full_scale}
    said = {name: getattr(taxels, name) for name in wanted}
    problem = next(
        (
            f"[taxels] {name} is {said[name]}, the {plugin} has {value}: set {name} = {value}"
            for name, value in wanted.items()
            if value != said[name]
        ),
        "",
    )
    if create.rate_hz != SAMPLE_RATE_HZ:
        problem = (
            f"the {plugin} gives {create.rate_hz} samples a second and rigctl records "
            f"{SAMPLE_RATE_HZ}: let the driver or its board give as many"
        )
    elif config.signals.sync and not create.has_sync:
        problem = f"the {plugin} reads no sync line: set [signals] sync = false"
    elif config.encoder.reading != "counts":
        problem = 'a conductance is known of our own board only: set [encoder] reading = "counts"'
    if problem:
        raise ConfigError(f"{config.about.name}: {problem}")
    return SensorDriver(plugin, create)


class _Numbered(NamedTuple):
    """Rows and counters of new samples; gaps and reboots with the place that they stand before."""

    rows: list[int]
    counters: list[int]
    gaps: list[tuple[int, Gap]]
    cuts: list[int]


class DriverDecoder:
    """Decodes the stream of a driver as :class:`~rigctl.boards.taxel_decoder.FrameDecoder` does.

    ``order``: the driver's column of each taxel, its own number where left out.
    A gap of more than a second, or a counter that runs back, is that of a reboot, unless the time
    that passed explains it. What a driver raises or returns wrongly raises LinkLost, which names
    it: what is recorded stays, and the next connection begins with a new object.
    """

    waiting = False

    def __init__(self, driver: SensorDriver, order: Sequence[int] | None = None) -> None:
        self._driver = driver
        self._order = list(range(driver.create.n_taxels) if order is None else order)
        self._last: int | None = None
        self._last_s = 0.0
        self._rises = 0
        self._was_high: bool | None = None
        self.resync()

    def resync(self) -> None:
        """Begin anew in the middle of a stream; the samples since the last one count as lost."""
        with self._driver.plugin.blamed(LinkLost):
            self._sensor = self._driver.create()

    def feed(self, data: bytes, at_s: float) -> Decoded:
        """Decode bytes that arrived at loop time ``at_s``. Raises LinkLost."""
        from rigctl.boards.taxel_decoder import Decoded

        with self._driver.plugin.blamed(LinkLost):
            found = self._sensor.decode(data)
            self._check(found)
        numbered = self._number(found.counters.tolist(), at_s)
        flags, edges = self._signals(found, numbered.rows)
        samples = found.samples[numbered.rows].take(self._order, axis=1)
        blocks = tuple(
            Block(
                np.array(numbered.counters[first:end], np.int64),
                samples[first:end],
                flags[first:end],
                edges[first:end],
                tuple(gap for at, gap in numbered.gaps if first <= at < end),
                at_s,
            )
            for first, end in pairwise([0, *numbered.cuts, len(samples)])
            if end > first
        )
        stale, rejected = len(found.counters) - len(samples), found.rejected_bytes
        reboots = len(numbered.cuts)
        return Decoded(blocks, (), (), (), reboots, int(rejected > 0), rejected, stale)

    def _number(self, sent: list[int], at_s: float) -> _Numbered:
        """Return which samples are new, their whole counters, and what lies between them."""
        found = _Numbered([], [], [], [])
        for row, number in enumerate(sent):
            counter, is_reboot = self._unwrap(number, at_s)
            if counter is None:
                continue
            if is_reboot:
                found.cuts.append(len(found.rows))
            elif self._last is not None and counter > self._last + 1:
                gap = Gap(self._last + 1, counter - self._last - 1, "lost on the line")
                found.gaps.append((len(found.rows), gap))
            found.rows.append(row)
            found.counters.append(counter)
            self._last, self._last_s = counter, at_s
        return found

    def _check(self, found: Readings) -> None:
        """Raise ValueError for arrays that are not what the contract says."""
        n, n_taxels = len(found.counters), self._driver.create.n_taxels
        if found.samples.dtype != np.uint16 or found.samples.shape != (n, n_taxels):
            shape = f"{found.samples.dtype} {found.samples.shape}"
            raise ValueError(f"samples are {shape} instead of uint16 {(n, n_taxels)}")
        if n and int(found.samples.max()) > self._driver.create.full_scale:
            raise ValueError(f"a reading of {found.samples.max()} is above full_scale")
        if self._driver.create.has_sync and (found.sync is None or len(found.sync) != n):
            raise ValueError("has_sync is true, but not every sample has a level of sync")

    def _unwrap(self, sent: int, at_s: float) -> tuple[int | None, bool]:
        """Return the whole counter, None for a stale one, and whether the board began again."""
        last, modulus = self._last, self._driver.create.counter_modulus
        if last is None:
            return sent, False
        ahead = (sent - last) % modulus
        if ahead == 0 or ahead > modulus - LATE:
            return None, False
        if ahead <= MAX_JUMP:
            return last + ahead, False
        expected = last + round((at_s - self._last_s) * SAMPLE_RATE_HZ)
        near = expected + (sent - expected + modulus // 2) % modulus - modulus // 2
        if near > last and abs(near - expected) <= MAX_JUMP:
            return near, False
        return sent, True

    def _signals(
        self, found: Readings, rows: list[int]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return flags and edges, uint8 (n,), from the levels of sync."""
        if found.sync is None or not rows:
            return np.zeros(len(rows), np.uint8), np.zeros(len(rows), np.uint8)
        high = found.sync[rows].astype(bool)
        before = np.concatenate(([high[0] if self._was_high is None else self._was_high], high))
        rises = self._rises + np.cumsum(~before[:-1] & high)
        self._rises, self._was_high = int(rises[-1]), bool(high[-1])
        return high.astype(np.uint8) * np.uint8(Flag.SYNC), (rises % 4).astype(np.uint8)
