"""What the virtual drum knows of its load cell: the ring, the force, the tare, its faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rigctl.wire.drum_map import RING_DEPTH
from rigctl.wire.drum_states import Fault
from rigctl.world.loadcell import FULL_SCALE

TARE_SAMPLES = 32
TARE_TRIES = 4
TARE_SPREAD_UG = 20_000_000
FROZEN_RUN = 8
SILENCE_PERIODS = 2.4
PERIOD_US = 12_500


class Tare(NamedTuple):
    """A finished tare; not steady when the drum swung all the time."""

    mean_counts: int
    steady: bool


class LoadcellWatch:
    """Samples as the board takes them, and what is wrong with them."""

    def __init__(self) -> None:
        self.sequence = 0
        self.raw = [0] * RING_DEPTH
        self.time_us = [0] * RING_DEPTH
        self.force_g = 0.0
        self.tare_counts = 0
        self.place_counts = 0.0
        self.ug_per_count = 0
        self.equal_run = 0
        self._tare: list[int] | None = None
        self._tries = TARE_TRIES

    @property
    def newest(self) -> int:
        """The newest raw reading, counts."""
        return self.raw[self.sequence % RING_DEPTH]

    @property
    def newest_us(self) -> int:
        """Board time of the newest reading, not wrapped."""
        return self.time_us[self.sequence % RING_DEPTH]

    def recent(self, count: int) -> tuple[int, ...]:
        """The newest raw readings, newest first."""
        return tuple(self.raw[(self.sequence - k) % RING_DEPTH] for k in range(count))

    def take(self, raw: int, board_us: int) -> None:
        """One conversion."""
        self.equal_run = self.equal_run + 1 if self.sequence and raw == self.newest else 0
        self.sequence += 1
        place = self.sequence % RING_DEPTH
        self.raw[place], self.time_us[place] = raw, board_us
        self.weigh()
        if self._tare is not None:
            self._tare.append(raw)

    def weigh(self) -> None:
        """Force from the newest reading with the tare and scale of now."""
        self.force_g = (
            (self.newest - self.tare_counts - self.place_counts) * self.ug_per_count * 1e-6
        )

    def faults(self) -> list[Fault]:
        """What the newest reading shows."""
        found = []
        if abs(self.newest) >= FULL_SCALE - 1:
            found.append(Fault.LOADCELL_SATURATED)
        elif self.equal_run + 1 >= FROZEN_RUN:
            found.append(Fault.LOADCELL_FROZEN)
        return found

    @property
    def taring(self) -> bool:
        """A tare has begun."""
        return self._tare is not None

    def taken(self, raws: Sequence[int], board_us: Sequence[int], equal_run: int) -> None:
        """Conversions that were taken elsewhere, none of them part of a tare."""
        for raw, at_us in zip(raws, board_us, strict=True):
            self.sequence += 1
            place = self.sequence % RING_DEPTH
            self.raw[place], self.time_us[place] = raw, at_us
        self.equal_run = equal_run

    def begin_tare(self) -> None:
        """Average the readings from here on."""
        self._tries = TARE_TRIES
        self._tare = []

    def abandon_tare(self) -> None:
        """Forget a tare that has begun."""
        self._tare = None

    def finished_tare(self) -> Tare | None:
        """A tare that is complete, once; None while it is not. A drum that swings is retried."""
        if self._tare is None or len(self._tare) < TARE_SAMPLES:
            return None
        spread_ug = (max(self._tare) - min(self._tare)) * abs(self.ug_per_count)
        steady = spread_ug <= TARE_SPREAD_UG
        if not steady and self._tries > 1:
            self._tries -= 1
            self._tare = []
            return None
        mean = round(sum(self._tare) / len(self._tare))
        self._tare = None
        return Tare(mean, steady)
