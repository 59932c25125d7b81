"""Benchmark the taxel board's firmware on its simulated chip; the same on any machine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rigctl.boards.taxel_frames import IDENTIFY, SELF_TEST, encode_request
from tests.firmware.taxels.chip import ENTRY_CYCLES, FRAME_CYCLES, TaxelChip

TIMED_FRAMES = 5_000
BOOT_FRAMES, WATCHED_FRAMES = 5, 500
JITTER = "peak to peak, worst taxel, stamped at the compare that triggers the converter"
NOTE = "build/firmware/taxels.elf on simavr, 18 taxels at 1 kHz, 500 kbaud, entry cycles added"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.taxels.*`` except lost frames, which need a million frames."""
    with TaxelChip() as board:
        board.run(TIMED_FRAMES)
        x, starts = board.x, board.sampled(0)
        drift = starts - starts[0] - FRAME_CYCLES * np.arange(starts.size)
        whole = board.sampled(17).size  # completely sampled frames
        offsets = [np.ptp(board.sampled(t)[:whole] - starts[:whole]) for t in range(18)]
        load = (x.isr_cycles + ENTRY_CYCLES * x.isr_count) / x.cycle
        yield row("frame_cycles_error", int(abs(drift[-1])), "cycles", f"{starts.size} frames")
        yield row("jitter_cycles", int(max(offsets)), "cycles", JITTER)
        yield row("idle_share", round(x.slept_cycles / x.cycle, 4), "", "asleep")
        yield row("isr_load", round(load, 4), "", "of all cycles")
        yield row("longest_isr_us", (max(x.longest_isr) + ENTRY_CYCLES) / 16, "µs", "entry added")
    off_us = interrupts_off_us()
    yield row("interrupts_off_us", off_us, "µs", f"outside of interrupts, {WATCHED_FRAMES} frames")


def interrupts_off_us() -> float:
    """Return the longest time with interrupts off in the main program, with requests and tests."""
    with TaxelChip() as board:
        board.run(BOOT_FRAMES)
        board.x.watch_interrupts = 1
        for _ in range(WATCHED_FRAMES // 50):
            board.chip.send(encode_request(IDENTIFY) + encode_request(SELF_TEST))
            board.run(50)
        return float(board.x.longest_off + ENTRY_CYCLES) / 16


def row(name: str, value: float, unit: str, what: str) -> dict[str, Any]:
    """Return a row of the benchmarks."""
    return {
        "name": f"firmware.taxels.{name}",
        "value": value,
        "unit": unit,
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"{what}; {NOTE}",
    }
