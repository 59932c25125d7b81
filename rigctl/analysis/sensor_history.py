"""How a sensor's taxels read over its sessions: gain, noise and ageing, from reference trials.

Reference trials are those on the smooth plate at one force that sessions have anyway. A protocol
with several ``mounts`` brings them up again and again in a session.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.sensor_response import mean_readings
from rigctl.analysis.trial_set import TrialSet, join_sessions
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.reading import Reading
from rigctl.errors import WrongUse

DAYS_A_MONTH = 30.0
LEAST_DAYS = 1.0
"""Ageing is a slope over days: sessions of one day have none."""
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SensorHistory:
    """The reference trials of a sensor's sessions, in order of time.

    ``gain``: float64 (n_sessions, n_taxels), mean reading over that of the first session at the
    same speeds; ``noise``: the standard deviation of equal trials of one mounting, a share of the
    mean, NaN without repeats; ``day``: float64 (n_sessions,), since the first session.
    """

    sensor: str
    texture: str
    force_g: float
    paths: tuple[Path, ...]
    begun_utc: tuple[str, ...]
    trials: tuple[int, ...]
    day: Floats
    gain: Floats
    noise: Floats

    @property
    def ageing(self) -> Floats:
        """Change of each taxel's gain in 30 days, a share, float64 (n_taxels,); NaN in one day."""
        days = self.day - self.day.mean()
        if np.ptp(self.day) < LEAST_DAYS:
            return np.full(self.gain.shape[1], np.nan)
        slopes = days @ np.log(self.gain) / np.square(days).sum()
        ageing: Floats = np.expm1(DAYS_A_MONTH * slopes)
        return ageing


def sensor_history(
    paths: Sequence[Path],
    texture: str = published.SMOOTH,
    force_g: float = REFERENCE_FORCE_G,
    reading: Reading = Reading.CONDUCTANCE,
) -> SensorHistory:
    """Return how the taxels read in the reference trials of some sessions of one sensor.

    Raises WrongUse for sessions of several sensors, and for one without a reference trial at a
    speed of the first one's; SessionError for a session that cannot be read.
    """
    sets = [_reference_trials(path, texture, force_g, reading) for path in paths]
    sets.sort(key=lambda trials: _begun(trials))
    names = {str(trials.provenance[0]["sensor"]) for trials in sets}
    if len(names) > 1:
        raise WrongUse(f"the sessions are of several sensors: {', '.join(sorted(names))}")
    means = [_by_speed(trials) for trials in sets]
    first = {speed: of.mean(axis=0) for speed, of in means[0].items()}
    gain = [_gain(trials, of, first) for trials, of in zip(sets, means, strict=True)]
    begun = [_begun(trials) for trials in sets]
    return SensorHistory(
        names.pop(),
        texture,
        force_g,
        tuple(trials.paths[0] for trials in sets),
        tuple(str(trials.provenance[0]["begun_utc"]) for trials in sets),
        tuple(len(trials.trials) for trials in sets),
        np.array([(one - begun[0]).total_seconds() / 86_400 for one in begun]),
        np.array(gain),
        np.array([_noise(trials) for trials in sets]),
    )


def _reference_trials(path: Path, texture: str, force_g: float, reading: Reading) -> TrialSet:
    trials = join_sessions([path], reading=reading).without_gaps()
    other = [
        row
        for row, trial in enumerate(trials.trials)
        if (trial.texture, trial.force_g) != (texture, force_g)
    ]
    if len(other) == len(trials.trials):
        raise WrongUse(f"{path} has no trial on plate {texture} at {force_g:g} g")
    return trials.without(other, "")


def _begun(trials: TrialSet) -> datetime:
    return datetime.fromisoformat(str(trials.provenance[0]["begun_utc"]))


def _by_speed(trials: TrialSet) -> dict[float, Floats]:
    """Return the mean readings of the trials at each speed, float64 (n, n_taxels)."""
    readings = mean_readings(trials)
    speeds = np.array([trial.speed_mm_s for trial in trials.trials])
    return {float(speed): readings[speeds == speed] for speed in np.unique(speeds)}


def _gain(trials: TrialSet, of: dict[float, Floats], first: dict[float, Floats]) -> Floats:
    ratios = [
        of[speed].mean(axis=0) / np.maximum(first[speed], 1.0) for speed in of if speed in first
    ]
    if not ratios:
        raise WrongUse(
            f"{trials.paths[0]} has no reference trial at a speed of the first session's "
            f"({', '.join(f'{speed:g}' for speed in first)} mm/s)"
        )
    gain: Floats = np.mean(ratios, axis=0)
    return gain


def _noise(trials: TrialSet) -> Floats:
    """Return the deviation of trials of one speed and mounting, as a share of their mean."""
    readings = mean_readings(trials)
    keys = [(trial.speed_mm_s, trial.mount) for trial in trials.trials]
    squares, freedom = np.zeros(trials.n_taxels), 0
    for key in set(keys):
        of = readings[[row for row, one in enumerate(keys) if one == key]]
        squares += np.square(of / np.maximum(of.mean(axis=0), 1.0) - 1.0).sum(axis=0)
        freedom += len(of) - 1
    return np.sqrt(squares / freedom) if freedom else np.full(trials.n_taxels, np.nan)


def as_dict(found: SensorHistory) -> dict[str, Any]:
    """Return everything as values for JSON; None for a value that was not measured."""
    sessions = zip(found.paths, found.begun_utc, found.trials, found.gain, found.noise, strict=True)
    return {
        "sensor": found.sensor,
        "texture": found.texture,
        "force_g": found.force_g,
        "sessions": [
            {
                "session": str(path),
                "begun_utc": begun,
                "trials": n,
                "gain": _plain(gain),
                "noise": _plain(noise),
            }
            for path, begun, n, gain, noise in sessions
        ],
        "ageing_per_30_days": _plain(found.ageing),
    }


def _plain(values: Floats) -> list[float | None]:
    return [round(value, 5) if math.isfinite(value) else None for value in values.tolist()]


def table_lines(found: SensorHistory) -> list[str]:
    """Return a line for each session, and one for each taxel."""
    lines = [
        f"sensor {found.sensor or '(unnamed)'}, plate {found.texture} at {found.force_g:g} g; gain "
        "over the first session's",
    ]
    sessions = zip(found.begun_utc, found.trials, found.gain, found.noise, found.paths, strict=True)
    for begun, n, gain, noise, path in sessions:
        lines.append(
            f"{begun[:16]}  {n:4} trials  gain {np.median(gain):.3f} ({gain.min():.3f} to "
            f"{gain.max():.3f})  noise {_percent(float(np.median(noise)))}  {path}"
        )
    last = zip(found.gain[-1], found.noise[-1], found.ageing, strict=True)
    for number, (gain, noise, ageing) in enumerate(last, start=1):
        lines.append(
            f"taxel {number:2}: gain {gain:.3f}, noise {_percent(noise)}, "
            f"ageing {_percent(ageing)} in 30 days"
        )
    return lines


def _percent(share: float) -> str:
    return f"{100.0 * share:+.2f} %" if math.isfinite(share) else "not measured"
