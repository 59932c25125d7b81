"""When a condition may end before its repeats: a mean that is known narrowly enough."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.config.toml_section import number, text
from rigctl.values import PlannedTrial

QUANTITY_NAMES = {"sa_rate": "mean SA rate", "ra_rate": "mean RA rate"}
"""Mean spike rate of the SA or of the RA neurons over a trial, Hz per neuron."""

Condition = tuple[str, float, float, float]
"""Plate, speed in mm/s, force in g, depth in mm."""


@dataclass(frozen=True, slots=True)
class EarlyEnd:
    """A condition ends when the interval of its mean is at most so wide."""

    of: str = text(
        "sa_rate",
        "the mean that is to be known: `sa_rate` or `ra_rate`, spikes of a neuron and second over "
        "a trial",
        tuple(QUANTITY_NAMES),
    )
    half_width_hz: float = number(
        2.0, "Hz", 0.01, 1000, "the widest half of its interval, which a table has to give"
    )
    confidence_percent: float = number(95.0, "%", 50, 99.9, "what the interval promises")
    least_trials: int = number(5, "", 5, 100_000, "trials of a condition before it may end")


def condition_of(trial: PlannedTrial) -> Condition:
    """Return plate, speed, force and depth of a trial."""
    return trial.texture, trial.speed_mm_s, trial.force_g, trial.depth_mm
