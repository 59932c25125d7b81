"""The same trials on virtual boards and on chips: one firmware, so the same states and results."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import SETTINGS
from rigctl.boards.drum_states import State
from rigctl.boards.taxel_frames import Flag
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from tests.contract.operator import NOMINAL, Operator
from tests.firmware.drum.support.plant_drum import evaluate_trial

SEED = 5
PLATES = ("A", "L")
TRIALS = ((80.0, 500.0), (120.0, 250.0), (120.0, 1000.0))
REST_S = 0.3
TRAVEL_MM = 80.0
MEAN_FORCE = 0.003
SETTLING_S = 0.020
BEHIND_S = 0.005
PERIOD_S = 1 / (NOMINAL.loadcell_rate_hz * (1 + NOMINAL.loadcell_clock_ppm * 1e-6))
AT_REST = (
    "magic",
    "map_version",
    "board_id",
    "firmware_version",
    "build_hash",
    "boot_count",
    "reset_cause",
    "steps_per_turn",
    "nm_per_step",
    "state",
    "fault",
    "fault_bits",
    "steps",
    "angle",
    "speed",
    "actuator_drive",
    "command_result",
    "sync_count",
    "index_count",
    "index_error_steps",
    "status_bits",
    "settings_from",
)
NOISY = {"tare_counts", "stiffness_g_per_mm", "heartbeat", "command_sequence"}
"""Registers that depend on the load cell's noise or on the number of polls."""
STIFFNESS = 0.03


@dataclass
class RunResults:
    """The results of one kind of rig."""

    states: list[State] = field(default_factory=list)
    registers: dict[str, float] = field(default_factory=dict)
    forces_g: list[NDArray[np.float64]] = field(default_factory=list)
    settled_s: list[float] = field(default_factory=list)
    windows: list[NDArray[np.uint16]] = field(default_factory=list)


async def just_after_a_conversion(at: Operator) -> None:
    """Wait until :data:`BEHIND_S` after a conversion, whose phase depends on the board's boot."""
    await at.watch(0.1)
    poll = at.states[-1]
    converted_s = poll.at_s - 1e-6 * (poll.board_time_us - poll.loadcell[-1].board_time_us)
    periods = math.ceil((at.now_s - converted_s - BEHIND_S) / PERIOD_S) + 1
    await asyncio.sleep(converted_s + BEHIND_S + periods * PERIOD_S - at.now_s)


async def do_trial(at: Operator, results: RunResults, speed_mm_s: float, force_g: float) -> None:
    """Make one contact; add its ground truth and the samples of its window to the results."""
    await at.drum.set(speed_set=speed_mm_s, force_set=force_g, travel_set=TRAVEL_MM)
    await at.do(Command.HOME, 20.0)  # to the upper end, so that both descend equally far
    await at.drum.set(move_target=1280.0)
    await at.do(Command.MOVE, 20.0)
    await just_after_a_conversion(at)
    at.clear_record()
    at.simulation.truth.take()
    await at.do(Command.APPROACH, 20.0)
    await at.watch(REST_S)
    rest_ms = len(at.simulation.truth.arrays().sync)
    await at.do(Command.RUN, 20.0)
    await at.do(Command.RETRACT, 10.0)
    truth = at.simulation.truth.take()
    forces = truth.force_g.astype(np.float64)
    inside = np.flatnonzero(truth.sync)
    trial = evaluate_trial(forces, rest_ms, slice(inside[0], inside[-1] + 1), force_g)
    results.forces_g.append(trial.window)
    results.settled_s.append(trial.settle_s)
    results.windows.append(at.samples[(at.flags & np.uint8(Flag.SYNC)) > 0])
    results.states += [State(s.state) for s in at.states]


async def play(at: Operator, results: RunResults) -> None:
    """Connect, arm, tare, home, and run all trials on each plate."""
    await at.connect()
    await at.drum.set(clock_trim_ppm=at.clocks_ppm["drum"], run_in_set=60.0)
    await at.reach(State.ARMED)
    await at.do(Command.TARE)
    for plate in PLATES:
        at.simulation.set_plate(plate)
        for speed_mm_s, force_g in TRIALS:
            await do_trial(at, results, speed_mm_s, force_g)
    await at.watch(0.5)
    results.registers = await at.drum.get(*AT_REST, *(entry.name for entry in SETTINGS))


def run_all_trials(kind: str) -> RunResults:
    rig = open_rig(kind, seed=SEED, paced=False)
    asyncio.set_event_loop(rig.loop)
    results = RunResults()
    try:
        at = Operator(rig)
        at.run(play(at, results))
    finally:
        asyncio.set_event_loop(None)
        rig.close()
    return results


@pytest.fixture(scope="module")
def results(images: object) -> Iterator[tuple[RunResults, RunResults]]:
    yield run_all_trials(VIRTUAL), run_all_trials(FIRMWARE)


def changes(states: list[State]) -> list[State]:
    """Return the states in order, without repeats."""
    return [s for i, s in enumerate(states) if i == 0 or states[i - 1] is not s]


def test_both_have_the_same_states(results: tuple[RunResults, RunResults]) -> None:
    virtual, chips = results
    assert changes(virtual.states) == changes(chips.states)
    assert State.RUN in virtual.states


def test_both_have_the_same_registers_at_rest(results: tuple[RunResults, RunResults]) -> None:
    virtual, chips = (kind.registers for kind in results)
    different = {name for name in virtual if virtual[name] != chips[name]}
    assert different <= NOISY
    noise_counts = 1e6 * NOMINAL.loadcell_noise_g / NOMINAL.loadcell_ug_per_count
    assert abs(virtual["tare_counts"] - chips["tare_counts"]) < noise_counts
    stiffness = virtual["stiffness_g_per_mm"], chips["stiffness_g_per_mm"]
    assert stiffness[0] == pytest.approx(stiffness[1], rel=STIFFNESS)


def test_true_forces_are_the_same(results: tuple[RunResults, RunResults]) -> None:
    virtual, chips = results
    for virtual_g, chip_g in zip(virtual.forces_g, chips.forces_g, strict=True):
        print(f"true mean force {virtual_g.mean():.2f} g virtual, {chip_g.mean():.2f} g on chips")
        assert virtual_g.mean() == pytest.approx(chip_g.mean(), rel=MEAN_FORCE)


def test_forces_settle_in_the_same_time(results: tuple[RunResults, RunResults]) -> None:
    virtual, chips = results
    print("settled, s:", virtual.settled_s, "virtual,", chips.settled_s, "on chips")
    np.testing.assert_allclose(virtual.settled_s, chips.settled_s, rtol=0, atol=SETTLING_S)


def test_samples_differ_only_by_the_noise_of_the_converter(
    results: tuple[RunResults, RunResults],
) -> None:
    virtual, chips = results
    for window, chip_window in zip(virtual.windows, chips.windows, strict=True):
        assert abs(len(window) - len(chip_window)) <= 1
        difference = window.mean(axis=0) - chip_window.mean(axis=0)
        largest = float(np.abs(difference).max())
        print("largest difference of a taxel's mean, counts:", round(largest, 3))
        assert largest < NOMINAL.adc_noise_counts
