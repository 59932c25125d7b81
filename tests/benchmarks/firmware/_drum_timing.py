"""Measure the drum controller's timing: pulses, ramps, interrupts, idle time, load-cell reads."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.chips.simavr import Output
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State
from tests.benchmarks.firmware._firmware_rows import FAST_ACCEL, GRBL, PREDECESSOR, US, figure
from tests.firmware.drum.support.chip import ENTRY_CYCLES, DrumChip
from tests.firmware.drum.support.plant_drum import PlantDrum

STEP_MM = 0.03125
SPEEDS_MM_S = tuple(range(40, 121, 5))
ACCELERATIONS = (100, 600, 2000)
FINE_SPEED_MM_S = 160
KLIPPER = "Klipper on a 16 MHz AVR takes 102 ticks a step with nothing else to do (its Benchmarks)"


@dataclass
class Extremes:
    """The worst values of all runs."""

    isr: int = 0
    off: int = 0
    read: int = 0
    latency: int = 0
    unused: int = 0
    stack: int = 8192
    build: int = 0

    def update(self, drum: DrumChip) -> None:
        """Include the values of a chip."""
        x = drum.x
        self.isr = max(self.isr, max(x.longest_isr) + ENTRY_CYCLES)
        self.off = max(self.off, x.longest_off)
        self.read = max(self.read, x.longest_read)
        self.latency = max(self.latency, x.loadcell_latency)
        self.unused += max(0, int(x.loadcell_conversions - x.loadcell_reads) - 1)
        self.stack = min(self.stack, drum.get("free_stack_bytes"))


@dataclass(frozen=True)
class Run:
    """Errors of the step pulses of one RUN: cycles, ppm, steps."""

    jitter: float
    rate_ppm: float
    steps_off: int


def timing() -> Iterator[dict[str, Any]]:
    """Yield the timing figures."""
    worst = Extremes()
    with PlantDrum() as drum:
        drum.prepare()
        drum.hold(500)
        drum.x.watch_interrupts = 1
        runs = [run(drum, speed, STEP_MM) for speed in SPEEDS_MM_S]
        idle = idle_share(drum)
        worst.update(drum)
        worst.build = drum.get("build_hash")
    yield from _pulse_rows(runs)
    yield figure("acceleration_error", acceleration_error(), "", f"at {ACCELERATIONS} mm/s²")
    yield highest_step_rate(worst)
    run_fast_moves(worst)
    yield figure("idle_share", idle, "", "asleep at 120 mm/s in contact, 50 polls a second")
    yield from _extreme_rows(worst)


def _pulse_rows(runs: list[Run]) -> Iterator[dict[str, Any]]:
    scene = f"{len(runs)} runs at {SPEEDS_MM_S[0]}–{SPEEDS_MM_S[-1]} mm/s in contact, 50 Hz polls"
    jitter = max(r.jitter for r in runs)
    yield figure("step_jitter_cycles", jitter, "cycles", f"{scene}; the simulator's floor is 5")
    rate = max(r.rate_ppm for r in runs)
    yield figure("rate_error_ppm", rate, "ppm", scene, f"speed off by 4.6 %, {PREDECESSOR}", 46e3)
    off = sum(r.steps_off for r in runs)
    yield figure("step_count_error", off, "steps", f"{scene}, ramps included, pin against count")


def _extreme_rows(worst: Extremes) -> Iterator[dict[str, Any]]:
    scene = "runs, moves at 10,240 steps/s, approach, save, homing"
    yield figure("longest_isr_us", worst.isr / US, "µs", f"entry added; {scene}")
    yield figure("interrupts_off_us", worst.off / US, "µs", f"outside of interrupts; {scene}")
    yield figure("loadcell_read_us", worst.read / US, "µs", f"first clock edge to last; {scene}")
    yield figure("loadcell_latency_us", worst.latency / US, "µs", f"ready to read; {scene}")
    yield figure("loadcell_unused", worst.unused, "", f"conversions not read; {scene}")
    what = f"never used of 8192, build {worst.build:08x}; {scene}"
    yield figure("free_stack_bytes", worst.stack, "bytes", what)


def run(drum: DrumChip, speed_mm_s: float, step_mm: float) -> Run:
    """Run once from HOLD; return the pulse errors in the window and of the step count."""
    drum.set("speed_set", round(100 * speed_mm_s))
    before = drum.get("steps")
    drum.clear_edges()
    assert drum.command(Command.RUN, 20_000) == 0
    assert drum.state is State.HOLD
    steps, sync = drum.steps(), drum.edges(Output.SYNC)[:, 0]
    wanted = 16e6 * step_mm / speed_mm_s
    inside = steps[(steps > sync[0] - wanted / 2) & (steps < sync[1])]
    intervals = np.diff(inside)
    return Run(
        jitter=float(np.abs(intervals - wanted).max()),
        rate_ppm=abs(float(intervals.mean()) / wanted - 1) * 1e6,
        steps_off=abs(int(steps.size) - (drum.get("steps") - before)),
    )


def acceleration_error() -> float:
    """Return the largest relative error of the acceleration over whole ramps."""
    with DrumChip() as drum:
        drum.arm()
        drum.set("move_speed_set", 20_000)
        errors = []
        for acceleration in ACCELERATIONS:
            drum.set("acceleration_set", acceleration)
            drum.set("move_target", drum.get("steps") + 12_800)
            drum.clear_edges()
            assert drum.command(Command.MOVE, 30_000) == 0
            errors.append(ramp_error(drum.steps(), acceleration))
        return max(errors)


def ramp_error(steps: NDArray[np.int64], acceleration_mm_s2: float) -> float:
    """Return the largest relative error of the mean acceleration from the first pulse on."""
    to_speed = int(200.0**2 / (2 * acceleration_mm_s2) / STEP_MM) - 2
    n = np.arange(50, min(to_speed, steps.size // 2 - 1))
    seconds = (steps[n - 1] - steps[0]) / 16e6
    seen = ((np.sqrt(2 * n * STEP_MM) - np.sqrt(2 * STEP_MM)) / seconds) ** 2
    return float(np.abs(seen / acceleration_mm_s2 - 1).max())


def highest_step_rate(worst: Extremes) -> dict[str, Any]:
    """Return steps per second in RUN with a closed force loop; the variant has 32 microsteps."""
    parameters = WorldParameters(steps_per_turn=25_600)
    with PlantDrum(parameters, image="firmware/drum-fine.elf") as drum:
        drum.prepare()
        drum.set("run_in_set", 900)
        drum.hold(500)
        drum.x.watch_interrupts = 1
        result = run(drum, FINE_SPEED_MM_S, STEP_MM / 2)
        assert result.steps_off == 0 and result.rate_ppm < 5
        assert drum.x.loadcell_conversions - drum.x.loadcell_reads <= 1
        worst.update(drum)
    rate = FINE_SPEED_MM_S / (STEP_MM / 2)
    what = f"force loop closed, polls, load cell; jitter {result.jitter:.1f} cycles; {KLIPPER}"
    return figure("max_steps_per_s", rate, "steps/s", f"{what}; {FAST_ACCEL}: 50,000", GRBL, 3e4)


def run_fast_moves(worst: Extremes) -> None:
    """Home, move, save and approach at full speed while each instruction is watched."""
    with PlantDrum() as drum:
        drum.arm()
        drum.x.watch_interrupts = 1
        assert drum.command(Command.HOME, 20_000) == 0
        drum.set("move_speed_set", 32_000)
        drum.set("move_target", drum.get("steps") + 25_600)
        assert drum.command(Command.MOVE, 20_000) == 0
        assert drum.command(Command.SAVE, 3000) == 0
        drum.hold(1000)
        assert drum.command(Command.RETRACT, 5000) == 0
        worst.update(drum)


def idle_share(drum: DrumChip) -> float:
    """Return the share of cycles asleep in the middle of a run at 120 mm/s."""
    drum.set("speed_set", 12_000)
    assert drum.command(Command.RUN) == 0
    drum.poll_for(500)
    slept, cycle = drum.x.slept_cycles, drum.x.cycle
    drum.poll_for(1500)
    share = (drum.x.slept_cycles - slept) / (drum.x.cycle - cycle)
    drum.poll_for(2000)
    return float(share)
