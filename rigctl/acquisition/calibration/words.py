"""Results of calibrations in words, for every client."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.acquisition.calibration.calibration_values import ForceLoopGains
from rigctl.values import DRAWN_WIRING


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
