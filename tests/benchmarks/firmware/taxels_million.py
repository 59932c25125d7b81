"""Count the lost frames of a million on the taxel board's simulated chip."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from typing import Any

from tests.benchmarks.firmware.taxels import row
from tests.firmware.taxels.chip import TaxelChip

FRAMES = 1_000_000
SLICE_FRAMES = 20
PRINT_EVERY_S = 10.0


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.taxels.lost_frames``."""
    start_s = printed_s = time.monotonic()
    lost, last, rejected = 0, -1, 0
    with TaxelChip() as board:
        board.x.report_samples = 0
        while last < FRAMES - 1:
            board.run_slice(SLICE_FRAMES)
            for block in board.blocks:
                lost += int(block.counters[-1]) - last - len(block)
                last = int(block.counters[-1])
            board.blocks.clear()
            board.statuses[:-1] = []
            if time.monotonic() - printed_s > PRINT_EVERY_S:
                printed_s = time.monotonic()
                _print_progress(last + 1, printed_s - start_s)
        rejected = board.rejected
        dropped = board.statuses[-1].frames_dropped
    what = f"of {last + 1}, {dropped} dropped by the board, {rejected} damaged"
    yield row("lost_frames", lost, "frames", what)


def _print_progress(done: int, passed_s: float) -> None:
    left_s = passed_s * (FRAMES - done) / done
    print(f"taxels_million: {done:,} frames, {left_s:.0f} s left", file=sys.stderr, flush=True)
