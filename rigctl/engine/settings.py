"""Drum settings and positions in steps, from a rig's description and a trial."""

from __future__ import annotations

from typing import Final

from rigctl.boards.drum_codes import ForceMode, Signal
from rigctl.boards.drum_registers import BY_NAME
from rigctl.config.rig_config import DrumGeometry, Inverted, RigConfig, Signals
from rigctl.protocol.plan import Settle
from rigctl.values import PlannedTrial

MAX_TARGET_STEPS: Final = 1_900_000
"""The board takes MOVE targets up to two million steps; before that the drum homes again."""

GUARDED_SETTINGS: Final = (
    "over_force",
    "scale_ug_per_count",
    "optional_signals",
    "signal_polarity",
    "loadcell_slow",
)
"""Settings that decide what a force means or what stops the drum. The board takes them only while
it is lifted and at rest, with the emergency stop closed."""

_TARGET: Final = BY_NAME["move_target"]


def rig_settings(config: RigConfig) -> dict[str, float]:
    """Return the settings that stay for a run, in engineering units by name."""
    actuator, drum = config.actuator, config.drum
    return {
        "acceleration_set": drum.acceleration_mm_s2,
        "run_in_set": drum.run_in_mm,
        "move_speed_set": drum.rapid_mm_s,
        "over_force": config.limits.over_force_g,
        "lift_clearance_um": actuator.lift_clearance_mm * 1000,
        "approach_limit_um": actuator.approach_limit_mm * 1000,
        "stiffness_g_per_mm": actuator.stiffness_g_per_mm,
        "dead_band_permille": actuator.dead_band_permille,
        "scale_ug_per_count": config.loadcell.scale_ug_per_count,
        "loadcell_slow": float(config.loadcell.rate_hz == 10),
        "gain_p": actuator.gain_p_per_s,
        "gain_i": actuator.gain_i_per_s,
        "optional_signals": _signal_bits(config.signals),
        "signal_polarity": _signal_bits(config.inverted),
    }


def _signal_bits(flags: Signals | Inverted) -> int:
    return sum(1 << signal for signal in Signal if getattr(flags, signal.name.lower()))


def settle_settings(settle: Settle) -> dict[str, float]:
    """Return the settings that decide when the force has settled."""
    return {
        "settle_band": settle.band_percent * 10,
        "settle_time_ms": settle.time_s * 1000,
        "approach_timeout_ms": settle.timeout_s * 1000,
    }


def trial_settings(trial: PlannedTrial, drum: DrumGeometry) -> dict[str, float]:
    """Return the set-points of one trial."""
    backward = (trial.direction == "backward") != drum.backwards
    mode = ForceMode[trial.force_mode.upper()]
    if mode is ForceMode.POSITION:
        press = {"depth_set_um": trial.depth_mm * 1000}
    else:
        press = {"force_set": trial.force_g}
    return {
        "speed_set": trial.speed_mm_s,
        "travel_set": trial.travel_mm + drum.sync_margin_mm,
        "direction_set": float(backward),
        "force_mode": float(mode),
        **press,
    }


def press_settings(force_g: float) -> dict[str, float]:
    """Return the set-points of an approach without travel."""
    return {"force_set": force_g, "force_mode": float(ForceMode.HOLD)}


def trial_start_steps(trial: PlannedTrial, drum: DrumGeometry, mm_per_step: float) -> int:
    """Return where the trial's run-in begins, in steps from the index mark within one turn."""
    start_mm = drum.plate_start_mm
    if trial.direction == "backward":
        start_mm += drum.plate_length_mm
    sign = -1 if drum.backwards else 1
    return sign * round(start_mm / mm_per_step)


def way_to_window_mm(
    trial: PlannedTrial, current_steps: int, drum: DrumGeometry, mm_per_step: float
) -> float:
    """Return the travel in the trial's direction to the next place where its window opens."""
    backward = trial.direction == "backward"
    sign = -1 if backward != drum.backwards else 1
    start_mm = trial_start_steps(trial, drum, mm_per_step) - current_steps
    way_mm = sign * start_mm * mm_per_step + drum.run_in_mm
    return way_mm % drum.circumference_mm


def jog_target_steps(
    current_steps: int, travel_mm: float, drum: DrumGeometry, mm_per_step: float
) -> int:
    """Return the position after this travel, forwards where positive, within the board's limits."""
    sign = -1 if drum.backwards else 1
    target = current_steps + sign * round(travel_mm / mm_per_step)
    return round(min(max(target, _TARGET.low), _TARGET.high))


def nearest_steps(within_turn: int, current_steps: int, steps_per_turn: int) -> int:
    """Return the position nearest to the current one that is at ``within_turn`` of its turn."""
    turns = round((current_steps - within_turn) / steps_per_turn)
    return within_turn + steps_per_turn * turns
