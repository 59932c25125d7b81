"""Stimulation patterns of a trial: biphasic pulses by channel, within limits, as a file.

A spike becomes a pulse, whose amplitude follows the reading of its taxel. Limits of refractory
period, rate and charge are applied here, in the order of time; what they took is counted. They are
no substitute for the limits of a stimulator.
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.settings import StimulationSettings
from rigctl.analysis.train_choice import parse_choice
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import Spikes

US_PER_S = 1_000_000
US_PER_SAMPLE = 1000
PC_PER_NC = 1000
COLUMNS = ("channel", "name", "at_us", "amplitude_ua", "phase_us", "interphase_us", "charge_nc")
FORMATS = (".csv", ".json")


class Channel(NamedTuple):
    """A channel of a stimulator: its name, and the trains whose spikes it plays."""

    name: str
    rows: tuple[int, ...]


class Pulses(NamedTuple):
    """The pulses of a channel: int64 µs from the start of the trial, float64 µA.

    ``taken``: spikes without a pulse, and pulses made smaller, by the limit that did it.
    """

    channel: Channel
    at_us: NDArray[np.int64]
    amplitude_ua: NDArray[np.float64]
    taken: dict[str, int]


class PulseTrain:
    """Makes the pulses of one channel in the order of time; remembers the last ones.

    ``taken``: spikes without a pulse, and pulses made smaller, by the limit that did it.
    """

    def __init__(self, settings: StimulationSettings) -> None:
        self.taken = Counter[str]()
        self._settings = settings
        self._recent: deque[int] = deque()
        self._charged: deque[tuple[int, float]] = deque()

    def amplitude_ua(self, at_us: int, reading: float) -> float:
        """Return the amplitude for a spike at a reading of 0 to 1; 0 where a limit forbids it."""
        wanted_ua = self._settings.amplitude_at(reading)
        allowed_ua = min(wanted_ua, self._settings.largest_ua)
        charge_nc = allowed_ua * self._settings.phase_us / PC_PER_NC
        if obstacle := self._obstacle(at_us, charge_nc):
            self.taken[obstacle] += 1
            return 0.0
        self.taken["charge a phase"] += allowed_ua < wanted_ua
        self._recent.append(at_us)
        self._charged.append((at_us, charge_nc))
        return allowed_ua

    def _obstacle(self, at_us: int, charge_nc: float) -> str:
        """Return which limit a pulse at this time would break, "" for none."""
        s = self._settings
        while self._recent and self._recent[0] <= at_us - s.rate_window_ms * US_PER_SAMPLE:
            self._recent.popleft()
        while self._charged and self._charged[0][0] <= at_us - US_PER_S:
            self._charged.popleft()
        if self._charged and at_us - self._charged[-1][0] < s.refractory_ms * US_PER_SAMPLE:
            return "refractory period"
        if len(self._recent) + 1 > s.most_pulses:
            return "rate"
        if sum(charge for _, charge in self._charged) + charge_nc > s.max_charge_nc_per_s:
            return "charge a second"
        return ""


def channels_of(settings: StimulationSettings, layout: SensorLayout) -> list[Channel]:
    """Return the channels that an analysis file names, or one for each train in a file's order.

    Raises WrongUse for a channel of trains that the sensor does not have.
    """
    if settings.channels:
        chosen = [parse_choice(text, layout) for text in settings.channels]
        return [Channel(one.name, one.rows) for one in chosen]
    return [Channel(name, (row,)) for name, row in layout.train_names()]


def pulses_of(
    spikes: Spikes,
    reading: NDArray[np.float64],
    channels: Sequence[Channel],
    settings: StimulationSettings,
) -> list[Pulses]:
    """Return the pulses of each channel: ``reading`` float64 (n, n_taxels), 0 to 1."""
    return [_pulses(channel, spikes, reading, settings) for channel in channels]


def _pulses(
    channel: Channel, spikes: Spikes, reading: NDArray[np.float64], settings: StimulationSettings
) -> Pulses:
    """Return the pulses of one channel; trains that fire together give one, of the largest."""
    strength: dict[int, float] = {}
    for row in channel.rows:
        of_taxel = reading[:, row % reading.shape[1]]
        for sample in spikes.train(row).tolist():
            strength[sample] = max(strength.get(sample, 0.0), float(of_taxel[sample]))
    made = PulseTrain(settings)
    at_us = [sample * US_PER_SAMPLE for sample in sorted(strength)]
    amplitudes = np.array([made.amplitude_ua(at, strength[at // US_PER_SAMPLE]) for at in at_us])
    given = amplitudes > 0
    taken = dict(+made.taken)
    return Pulses(channel, np.array(at_us, np.int64)[given], amplitudes[given], taken)


def describe_limits(pulses: Sequence[Pulses]) -> str:
    """Return in a sentence how many pulses there are and what the limits took."""
    n = sum(len(one.at_us) for one in pulses)
    total: Counter[str] = Counter()
    for one in pulses:
        total.update(one.taken)
    smaller = total.pop("charge a phase", 0)
    dropped = ", ".join(f"{count:,} by the {name}" for name, count in total.items()) or "none"
    return (
        f"{n:,} pulses on {len(pulses)} channels; spikes without a pulse: {dropped}; pulses made "
        f"smaller by the charge a phase: {smaller:,}"
    )


def check_stimulation_file(path: Path) -> None:
    """Raise WrongUse for a file that exists, or whose name has another end."""
    if path.suffix not in FORMATS:
        raise WrongUse(f"{path}: a stimulation pattern is {' or '.join(FORMATS)}")
    if path.exists():
        raise WrongUse(f"{path} already exists: name another file, or remove it")


def to_text(
    pulses: Sequence[Pulses], settings: StimulationSettings, about: str, suffix: str
) -> str:
    """Return a pattern as the text of a file of this kind; ``about``: whose it is, in words."""
    return (
        _to_json(pulses, settings, about) if suffix == ".json" else _to_csv(pulses, settings, about)
    )


def _to_csv(pulses: Sequence[Pulses], settings: StimulationSettings, about: str) -> str:
    """Return one line a pulse in the order of time, behind a line that says whose they are."""
    out = io.StringIO()
    out.write(f"# {about}; biphasic pulses, cathodic phase first\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    rows = [
        (at, number, one.channel.name, ua)
        for number, one in enumerate(pulses, start=1)
        for at, ua in zip(one.at_us.tolist(), one.amplitude_ua.tolist(), strict=True)
    ]
    for at, number, name, ua in sorted(rows):
        charge_nc = round(ua * settings.phase_us / PC_PER_NC, 4)
        shape = (settings.phase_us, settings.interphase_us)
        writer.writerow((number, name, at, round(ua, 3), *shape, charge_nc))
    return out.getvalue()


def _to_json(pulses: Sequence[Pulses], settings: StimulationSettings, about: str) -> str:
    """Return the pattern by channel, with its limits, for a script."""
    channels: list[dict[str, Any]] = [
        {
            "channel": number,
            "name": one.channel.name,
            "at_us": one.at_us.tolist(),
            "amplitude_ua": [round(ua, 3) for ua in one.amplitude_ua.tolist()],
            "taken_by_limits": one.taken,
        }
        for number, one in enumerate(pulses, start=1)
    ]
    pattern = {"about": about, "settings": asdict(settings), "channels": channels}
    return json.dumps(pattern, indent=1, ensure_ascii=False) + "\n"
