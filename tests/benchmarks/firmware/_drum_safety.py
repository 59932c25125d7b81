"""Measure how soon the drum controller makes the bench safe; each figure is the worst case."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from rigctl.bench.chips.simavr import Output
from rigctl.boards.drum_codes import Command, ResetCause
from rigctl.boards.drum_states import Fault, State
from tests.benchmarks.firmware._firmware_rows import US, figure
from tests.firmware.drum.support.cells import SILENT, enter
from tests.firmware.drum.support.checks import (
    HANGS,
    MOVING_STATES,
    enter_from_idle,
    hang_main_loop,
    open_emergency_stop,
)
from tests.firmware.drum.support.chip import ENTRY_CYCLES, G_PER_COUNT, MS, DrumChip
from tests.firmware.drum.support.plant_drum import PlantDrum

PHASES = (900, 5000, 12_345)
"""Cycles from the start of a millisecond to the opening of the emergency stop."""
FINE_CYCLES = 160
LIFTS = -0.95
PUSH_G = 1500.0
ABOVE_G = 150.0
OVER = "from the end of the second conversion above the settings' limit"


def safety() -> Iterator[dict[str, Any]]:
    """Yield the figures of the safety functions."""
    states = ", ".join(s.name for s in MOVING_STATES)
    what = f"{states}, and ARMED with a hung loop; {len(PHASES)} phases each; entry added"
    yield figure("estop_us", estop_us(), "µs", what)
    yield figure("overforce_lift_us", overforce_lift_us(), "µs", OVER)
    yield figure("loadcell_fault_periods", silent_periods(), "periods", "silence to lift, in HOLD")
    yield from heartbeat()
    yield from watchdog()


def estop_us() -> float:
    """Return the longest time from the input's edge until all drivers are off."""
    delays: list[int] = []
    with DrumChip() as drum:
        for state in (s for s in MOVING_STATES for _ in PHASES):
            enter(drum, state)
            delays.append(open_emergency_stop(drum, PHASES[len(delays) % len(PHASES)]))
    with DrumChip(HANGS) as drum:
        drum.arm()
        hang_main_loop(drum)
        delays.append(open_emergency_stop(drum, PHASES[0]))
    return (max(delays) + ENTRY_CYCLES) / US


def run_until(drum: DrumChip, condition: Callable[[], bool], limit_cycles: int) -> int:
    """Run in slices of 10 µs with frozen mechanics until a condition is true; return the cycle."""
    end = int(drum.x.cycle) + limit_cycles
    while not condition():
        assert drum.x.cycle < end, "the condition never became true"
        drum.chip.run(int(drum.x.cycle) + FINE_CYCLES)
    return int(drum.x.cycle)


def _reached(drum: DrumChip, cycle: int) -> bool:
    return bool(drum.x.cycle >= cycle)


def _next_begun(drum: DrumChip, ready: int) -> bool:
    return int(drum.x.loadcell_ready) > ready


def overforce_lift_us() -> float:
    """Return the longest time from the end of the conversion that decides to full lift.

    The force is above the settings' limit and below the raw one, so the second sample decides.
    """
    delays = []
    with PlantDrum() as drum:
        limit_g = drum.get("over_force") / 10
        for _ in range(5):
            enter(drum, State.HOLD)
            counts = drum.get("tare_counts") + round((limit_g + ABOVE_G) / G_PER_COUNT)
            first = int(drum.x.loadcell_ready)
            while drum.x.cycle + MS <= first:
                drum.run(1)
            drum.plant.set_disturbances(False, PUSH_G)
            drum.x.loadcell_counts = counts
            run_until(drum, partial(_next_begun, drum, first), 2 * MS)
            decides = int(drum.x.loadcell_ready)
            start = run_until(drum, partial(_reached, drum, decides), 20 * MS)
            assert drum.x.drive > LIFTS
            delays.append(run_until(drum, lambda: drum.x.drive < LIFTS, 2 * MS) - start)
            assert drum.get("fault") == Fault.OVER_FORCE
            drum.plant.set_disturbances(False, 0.0)
    return (max(delays) + ENTRY_CYCLES) / US


def silent_periods() -> float:
    """Return the time from the last conversion to full lift, in conversion periods."""
    with DrumChip() as drum:
        enter_from_idle(drum, State.HOLD)
        drum.beat()
        period = drum.x.loadcell_period_q16 / 65536
        last = int(drum.x.loadcell_ready)
        while drum.x.cycle < last:
            drum.run(1)
        drum.x.loadcell_mode = SILENT
        at = run_until(drum, lambda: drum.x.drive < LIFTS, 60 * MS)
        assert drum.get("fault") == Fault.LOADCELL_SILENT
        return float(round((at - last) / period, 2))


def heartbeat() -> Iterator[dict[str, Any]]:
    """Yield the times from the last heartbeat to the ramp, to full lift, and to all off."""
    with DrumChip() as drum:
        enter_from_idle(drum, State.RUN)
        drum.beat()
        begun = drum.last_byte_cycle
        drum.clear_edges()
        lifted = until_lifted(drum)
        drum.run(900)
        steps = drum.steps()
        slower = np.flatnonzero(np.diff(steps) > 1.02 * (steps[1] - steps[0]))
        off = int(drum.edges(Output.BRIDGE)[-1, 0])
        assert drum.get("fault") == Fault.HEARTBEAT
        assert drum.x.drive == 0
    ramp = int(steps[slower[0]])
    what = "from the last byte of the last beat, RUN at 80 mm/s"
    yield figure("heartbeat_ramp_ms", round((ramp - begun) / MS, 1), "ms", what)
    yield figure("heartbeat_lift_ms", round((lifted - begun) / MS, 1), "ms", what)
    yield figure("heartbeat_off_ms", round((off - begun) / MS, 1), "ms", what)


def until_lifted(drum: DrumChip) -> int:
    """Run until the actuator lifts at full duty; return the cycle, to a millisecond."""
    for _ in range(400):
        drum.run(1)
        if drum.x.drive < LIFTS:
            return int(drum.x.cycle)
    raise AssertionError("the drum never lifted")


def watchdog() -> Iterator[dict[str, Any]]:
    """Yield the time from the hang of the loop to the reset, with the fault afterwards."""
    with DrumChip(HANGS) as drum:
        enter_from_idle(drum, State.ARMED)
        drum.set("move_target", 30_000)
        assert drum.command(Command.MOVE) == 0
        drum.poll_for(300)
        hang_main_loop(drum)
        start, resets = int(drum.x.cycle), drum.x.resets
        while drum.x.resets == resets:
            assert drum.x.cycle < start + 200 * MS
            drum.run(1)
        delay_ms = (int(drum.x.cycle) - start) / MS
        drum.run(150)
        assert drum.x.drive == 0
        cause = ResetCause.WATCHDOG.name if drum.get("reset_cause") >> 3 & 1 else "none"
        fault = Fault(drum.get("fault")).name
    what = f"a hang in POSITION; afterwards reset cause {cause}, fault {fault}, all off"
    yield figure("watchdog_ms", round(delay_ms, 1), "ms", what)
