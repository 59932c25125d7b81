"""The first contact: tare, home, 100 g with the drum still, then a first short trial."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import Flag
from rigctl.engine.settings import press_settings
from rigctl.engine.setup.check_result import YES, YES_OR_NO, CheckResult, Question
from rigctl.engine.setup.context import SetupContext
from rigctl.engine.setup.load_cell import PRESS_CELL, PRESS_S, RELEASE_CELL
from rigctl.errors import WrongUse
from rigctl.values import Block, DrumState

FORCE_G = 100.0
BAND_G = 20.0
HOLD_S = 2.0
LEAST_CHANGE_COUNTS = 4.0
"""Of the taxel that changes most under 100 g."""
LEAST_STIFFNESS, MOST_STIFFNESS = 50.0, 3000.0
TRIAL = {"speed_set": 40.0, "travel_set": 60.0, "run_in_set": 60.0, "direction_set": 0.0}

MOUNT = Question(
    "mount_plate",
    "Put the sensor and a plate in, with the drum above the sensor, and keep clear: the drum "
    f"lifts, turns to its mark and presses with {FORCE_G:g} g, at most 250 g. Is everything in "
    "place?",
    YES_OR_NO,
)


class PressReadings(NamedTuple):
    """The first press: its force in g, how deep it is in mm, the largest change of a taxel."""

    force_g: float
    depth_mm: float
    taxel_counts: float


async def check_first_press(context: SetupContext) -> CheckResult:
    """Tare, home, and press with 100 g while the drum stands still."""
    await _require_mounted(context)
    await context.clear()
    motion = context.motion
    await motion.disarm()
    await _touch_cell(context)
    await motion.arm()
    await motion.tare(anyway=True)
    await motion.home()
    before = await context.taxel_samples(1.0)
    await motion.write_settings(**press_settings(FORCE_G))
    await motion.approach(by_setup=True)
    polls = await context.watch(HOLD_S)
    pressed = await context.taxel_samples(1.0)
    await motion.lift()
    return judge_press(_press_readings(polls, before, pressed))


async def _require_mounted(context: SetupContext) -> None:
    if await context.ask(MOUNT) != YES:
        raise WrongUse("put the sensor and a plate in, then check again")


async def _touch_cell(context: SetupContext) -> None:
    """Let the board feel a finger: it presses on nothing that it has not felt since its boot."""
    for question in (PRESS_CELL, RELEASE_CELL):
        await context.ask(question)
        await context.watch(PRESS_S)


def _press_readings(
    polls: Sequence[DrumState], before: NDArray[np.uint16], pressed: NDArray[np.uint16]
) -> PressReadings:
    forces = [sample.force_g for poll in polls for sample in poll.loadcell]
    last = polls[-1]
    depth_um = last.actuator_position_um - float(last.values["last_contact_um"])
    change = np.abs(pressed.mean(axis=0) - before.mean(axis=0)).max()
    return PressReadings(fmean(forces) if forces else 0.0, depth_um / 1000, float(change))


def judge_press(seen: PressReadings) -> CheckResult:
    """Judge the first press by its force, its depth, and what the sensor feels."""
    expected = (
        f"{FORCE_G - BAND_G:g} to {FORCE_G + BAND_G:g} g, and a taxel that changes by more than "
        f"{LEAST_CHANGE_COUNTS:g} counts"
    )
    found = (
        f"{seen.force_g:.0f} g at a depth of {seen.depth_mm:.2f} mm, and a taxel that changes by "
        f"{seen.taxel_counts:.0f} counts"
    )
    if abs(seen.force_g - FORCE_G) > BAND_G:
        problem = (
            "the force is not held: run rigctl calibrate force after the setup's load cell part, "
            "and check that the plate sits firmly"
        )
        return CheckResult(expected, found, problem)
    if seen.taxel_counts < LEAST_CHANGE_COUNTS:
        problem = (
            "the load cell feels a contact and the sensor does not: the drum presses beside the "
            "sensor or on its frame, or pressure lowers its readings; look from the side, and "
            "move the sensor under the drum"
        )
        return CheckResult(expected, found, problem)
    return CheckResult(expected, found)


class TrialReadings(NamedTuple):
    """Windows that the drum opened, and that the taxel board saw; its level at rest is ``high``."""

    sent: int
    seen: int
    is_high_at_rest: bool


async def check_first_trial(context: SetupContext) -> CheckResult:
    """Press with 100 g, turn through a short window, and compare both ends of the sync wire."""
    await _require_mounted(context)
    await context.clear()
    motion, blocks = context.motion, list[Block]()
    unsubscribe = context.rig.taxels.on_block(blocks.append)
    try:
        before = await context.look()
        await motion.arm()
        await motion.tare()
        await motion.home()
        await motion.write_settings(**press_settings(FORCE_G), **TRIAL)
        await motion.approach()
        await motion.run()
        await motion.lift()
        after = await context.look()
    finally:
        unsubscribe()
    sent = (int(after.values["sync_count"]) - int(before.values["sync_count"])) % 65536
    return judge_trial(_trial_readings(sent, blocks))


def _trial_readings(sent: int, blocks: Sequence[Block]) -> TrialReadings:
    levels = np.concatenate([block.flags for block in blocks]) & Flag.SYNC != 0
    rises = int(np.count_nonzero(~levels[:-1] & levels[1:]))
    falls = int(np.count_nonzero(levels[:-1] & ~levels[1:]))
    starts_high = bool(levels[0])
    return TrialReadings(sent, falls if starts_high else rises, starts_high)


def judge_trial(seen: TrialReadings) -> CheckResult:
    """Judge the sync wire by the windows at both of its ends."""
    expected = f"{seen.sent} window at the taxel board"
    level = "high" if seen.is_high_at_rest else "low"
    found = f"{seen.seen}, and a line that rests {level}"
    if seen.seen == seen.sent and not seen.is_high_at_rest:
        return CheckResult(expected, found)
    if seen.seen == seen.sent:
        return CheckResult(
            expected,
            found,
            "the sync line is the wrong way round: take the inverter out of the wire from the "
            "Mega's D24 to the Uno's D8, or set [inverted] sync = true in rig.toml",
        )
    return CheckResult(
        expected,
        found,
        "the taxel board saw no window: connect the Mega's D24 with the Uno's D8, and GND with "
        "GND, or set [signals] sync = false in rig.toml for trials that the drum's clock cuts",
        ("sync wire missing",),
    )


async def commission(context: SetupContext) -> CheckResult:
    """Let the board remember that the wiring is right; from now on it presses for protocols."""
    await context.motion.disarm()
    await context.motion.commission()
    settings_hash = round((await context.registers("settings_hash"))["settings_hash"])
    return CheckResult("the board takes its wiring as checked", f"settings {settings_hash:08x}")
