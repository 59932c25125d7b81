"""The taxel board's firmware, counted in cycles on its simulated chip; exact on any machine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tests.firmware.taxel_chip import ENTRY_CYCLES, FRAME_CYCLES, TaxelChip

TIMED_FRAMES = 5_000
FRAMES = 1_000_000
SLICE_FRAMES = 20
NOTE = "build/firmware/taxels.elf on simavr, 18 taxels at 1 kHz, 500 kbaud, entry cycles added"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.taxels.*``."""
    with TaxelChip() as board:
        board.run(TIMED_FRAMES)
        x, starts = board.x, board.sampled(0)
        drift = starts - starts[0] - FRAME_CYCLES * np.arange(starts.size)
        whole = board.sampled(17).size  # frames sampled to their end
        offsets = [np.ptp(board.sampled(t)[:whole] - starts[:whole]) for t in range(18)]
        load = (x.isr_cycles + ENTRY_CYCLES * x.isr_count) / x.cycle
        yield _row("frame_cycles_error", int(abs(drift[-1])), "cycles", f"{starts.size} frames")
        yield _row("jitter_cycles", int(max(offsets)), "cycles", "peak to peak, worst taxel")
        yield _row("idle_share", round(x.slept_cycles / x.cycle, 4), "", "asleep")
        yield _row("isr_load", round(load, 4), "", "")
        yield _row("longest_isr_us", (max(x.longest_isr) + ENTRY_CYCLES) / 16, "µs", "")
    yield _row("lost_frames", lost_frames(), "frames", f"of {FRAMES}")


def lost_frames(frames: int = FRAMES) -> int:
    """Frames missing among so many, by their counters."""
    with TaxelChip() as board:
        board.x.report_samples = 0
        while not board.statuses or board.statuses[-1].sample_counter < frames:
            board.run_slice(SLICE_FRAMES)
        return int(board.counters[-1] - board.counters[0] + 1 - board.counters.size)


def _row(name: str, value: float, unit: str, what: str) -> dict[str, Any]:
    return {
        "name": f"firmware.taxels.{name}",
        "value": value,
        "unit": unit,
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"{what}; {NOTE}" if what else NOTE,
    }
