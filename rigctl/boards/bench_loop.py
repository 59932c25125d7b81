"""The event loop of a real bench, whose clock goes on while the computer sleeps.

The boards' clocks do too. ``time.monotonic`` stands still meanwhile on Linux and macOS, so that a
board would seem to have restarted when the computer wakes.
"""

from __future__ import annotations

import asyncio
import sys
import time


class BenchLoop(asyncio.SelectorEventLoop):
    """A selector loop, as TCP links need one; ``time()`` counts the computer's sleep."""

    if sys.platform == "linux":

        def time(self) -> float:
            """Return the seconds since the computer started."""
            return time.clock_gettime(time.CLOCK_BOOTTIME)

    elif sys.platform == "darwin":

        def time(self) -> float:
            """Return the seconds since the computer started."""
            return time.clock_gettime(time.CLOCK_MONOTONIC)
