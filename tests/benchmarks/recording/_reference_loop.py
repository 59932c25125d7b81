"""A loop of plain Python: limits in milliseconds are stated for a processor that takes 15 ms."""

from __future__ import annotations

import time
from statistics import median

STATED_MS = 15.0
TURNS = 500_000
ROUNDS = 9


def slowness() -> float:
    """Return the processor time of the loop over that of the stated processor."""
    return median(_loop_ms() for _ in range(ROUNDS)) / STATED_MS


def _loop_ms() -> float:
    begun_s, total = time.thread_time(), 0
    for number in range(TURNS):
        total += number & 7
    return 1000 * (time.thread_time() - begun_s)
