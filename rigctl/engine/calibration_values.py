"""The results of calibrations, and what clients see of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rigctl.values import DRAWN_WIRING

LOADCELL, FORCE, IMBALANCE, WIRING = PARTS = ("loadcell", "force", "imbalance", "wiring")
RANGE = "range"
"""The part that is measured for the encoder; the board has nothing of it."""
LEAST_RATIO = 4
"""A range that is narrower, in spans of the untouched sensor, would let the noise fire."""


class MassReading(NamedTuple):
    """A known mass with the mean and standard deviation of the load cell's raw counts."""

    mass_g: float
    mean_counts: float
    sd_counts: float


class LoadCellScale(NamedTuple):
    """Slope with its sign; ``nonlinearity_share``: largest deviation over the largest mass."""

    ug_per_count: int
    nonlinearity_share: float


class ScaleLine(NamedTuple):
    """Mass = ``g_per_count`` · counts + ``offset_g``; ``residuals_g``: each mass less the line."""

    g_per_count: float
    offset_g: float
    residuals_g: tuple[float, ...]


class ForceLoopGains(NamedTuple):
    """Gains that a step test proposes, and what was measured of contact and actuator.

    ``dead_band_percent`` and ``stiction_percent`` are of the full duty: what moves the rod at all,
    and how much more it needs to begin. ``held_within_g``: half of what the held force moved by.
    """

    gain_p_per_s: float
    gain_i_per_s: float
    stiffness_g_per_mm: float
    delay_ms: float
    dead_band_percent: float
    stiction_percent: float
    actuator_mm_s: float
    held_within_g: float


class TaxelRange(NamedTuple):
    """The lowest and highest reading of each taxel, and by how much it moved while untouched."""

    low: tuple[int, ...] = ()
    high: tuple[int, ...] = ()
    rest: tuple[int, ...] = ()

    @property
    def problem(self) -> str:
        """Which taxels saw too little of the press and what to do, empty for none."""
        spans = zip(self.low, self.high, self.rest, strict=True)
        flat = [
            f"T{number} ({high - low}, untouched {rest})"
            for number, (low, high, rest) in enumerate(spans, 1)
            if high - low < LEAST_RATIO * max(rest, 1)
        ]
        if not flat:
            return ""
        return (
            f"the press moved these taxels by less than {LEAST_RATIO} times what they move "
            f"untouched: {', '.join(flat)}; see that a plate with ridges is mounted and reaches "
            "the whole sensor, run Taxel test for its wires, press with more force, then measure "
            "again"
        )


@dataclass(frozen=True, slots=True)
class CalibrationStatus:
    """What has been measured and not been discarded, of each part.

    ``measuring``: the part that is measured now, empty for none, for ``elapsed_s`` of ``usual_s``,
    which is 0 while a result is written.
    ``masses``: the readings with known masses, 0 g first; ``scale_ug_per_count`` and
    ``nonlinearity_share``: None without a plausible line, and ``scale_problem`` says why.
    ``taxel_range``: what the last press has shown, also where it was refused.
    ``imbalance_g``: contribution of each sixteenth of a turn. ``wiring_question``: what a person
    does before the next of the steps, which have numbers from 0; ``wiring_place``: the place to
    press, row by row from 0; ``wiring_pressed``: the readings of both layers at each place so
    far; ``wiring``: the reading at each place, empty before all are known.
    ``saved``: where the result of a part is saved, in words.
    """

    measuring: str = ""
    elapsed_s: float = 0.0
    usual_s: float = 0.0
    masses: tuple[MassReading, ...] = ()
    scale_ug_per_count: int | None = None
    nonlinearity_share: float | None = None
    scale_problem: str = ""
    gains: ForceLoopGains | None = None
    taxel_range: TaxelRange | None = None
    imbalance_g: tuple[float, ...] = ()
    wiring_step: int = 0
    wiring_question: str = ""
    wiring_place: int | None = None
    wiring_pressed: tuple[tuple[int, int], ...] = ()
    wiring: tuple[int, ...] = ()
    saved: Mapping[str, str] = field(default_factory=dict)
    rig_file: str = ""
    """The rig.toml that takes the results of a bench, empty for a simulated rig."""

    @property
    def has_unsaved_range(self) -> bool:
        """Whether the ranges of a press are in use, and not in rig.toml."""
        found = self.taxel_range
        return found is not None and not found.problem and RANGE not in self.saved


def scale_words(ug_per_count: int, nonlinearity_share: float) -> str:
    """Return a load cell's scale."""
    return f"{ug_per_count} µg a count, nonlinearity {100 * nonlinearity_share:.2f} %"


def gains_words(gains: ForceLoopGains) -> str:
    """Return the gains of the force loop and what they come from."""
    return (
        f"proportional gain {gains.gain_p_per_s:g} 1/s, integral gain {gains.gain_i_per_s:g} 1/s, "
        f"stiffness {gains.stiffness_g_per_mm:g} g/mm, delay {gains.delay_ms:g} ms; the actuator "
        f"makes {gains.actuator_mm_s:g} mm/s, rests below {gains.dead_band_percent:g} % duty, "
        f"begins to move {gains.stiction_percent:g} % above, and held the force within "
        f"±{gains.held_within_g:g} g"
    )


def imbalance_words(table_g: Sequence[float]) -> str:
    """Return half of what the load cell's error changes over a turn."""
    return f"imbalance {(max(table_g) - min(table_g)) / 2:.2f} g"


def wiring_words(wiring: Sequence[int]) -> str:
    """Return the reading at each place, and whether it is that of the drawing."""
    return f"wiring = {list(wiring)}{', as drawn' if tuple(wiring) == DRAWN_WIRING else ''}"
