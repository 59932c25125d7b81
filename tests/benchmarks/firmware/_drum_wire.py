"""Measure the drum's line: polls for ten minutes, and noise."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import SETTINGS_BLOCK
from rigctl.boards.drum_states import State
from tests.benchmarks.firmware._firmware_rows import US, figure
from tests.firmware.drum.support.chip import MS, DrumChip

POLLS_S = 50
SOAK_S = 600
FUZZ_BYTES = 1_000_000
PIECE_BYTES = 400
BYTE_CYCLES = 16e6 * 10 / 115_200
REQUEST_STARTS = (b"\x01\x10\x00\x40", b"\x01\x06\x00\x45", b"\x01\x17\x00\x10", b"\x01\x03\x00")
"""First bytes of requests: a third of the noise begins like a request."""


def wire() -> Iterator[dict[str, Any]]:
    """Yield the figures of the line."""
    polls, missed, slowest = soak(SOAK_S)
    scene = f"{polls} polls at {POLLS_S} Hz while the drum runs trial after trial in contact"
    yield figure("poll_timeouts", missed, "", scene)
    yield figure("reply_start_us", round(slowest, 1), "µs", f"last byte to first; {scene}")
    changed, resets = fuzz(FUZZ_BYTES)
    what = f"{FUZZ_BYTES} bytes, a third of the pieces look like requests; {resets} resets"
    yield figure("fuzz_changed_registers", changed, "", what)


def soak(seconds: int) -> tuple[int, int, float]:
    """Return polls, unanswered polls, and the longest wait for a reply's first bit, µs."""
    missed, polls, slowest = 0, 0, 0.0
    with DrumChip() as drum:
        drum.arm()
        drum.hold(500)
        end = int(drum.x.cycle) + seconds * 1000 * MS
        while drum.x.cycle < end:
            if polls % 250 == 0 and drum.state is State.HOLD:
                assert drum.command(Command.RUN) == 0
            begun = int(drum.x.cycle) // MS
            missed += not drum.beat()
            waited = drum.first_reply_cycle - BYTE_CYCLES - drum.last_byte_cycle
            slowest = max(slowest, waited / US)
            polls += 1
            drum.run(max(0, begun + 1000 // POLLS_S - int(drum.x.cycle) // MS))
            drum.clear_edges()
            drum.forces.clear()
        assert drum.get("crc_errors") == 0
    return polls, missed, slowest


def fuzz(n_bytes: int) -> tuple[int, int]:
    """Send noise; return the changed bytes of settings and the resets. Fail on any motion."""
    dice = np.random.default_rng(3)
    first, count = SETTINGS_BLOCK
    read = bytes([3, first >> 8, first & 0xFF, 0, count])
    with DrumChip() as drum:
        drum.run(100)
        before = drum.exchange(read)
        drum.clear_edges()
        for piece in range(n_bytes // PIECE_BYTES):
            start = REQUEST_STARTS[piece // 3 % len(REQUEST_STARTS)] if piece % 3 == 0 else b""
            noise = dice.integers(0, 256, PIECE_BYTES - len(start), np.uint8).tobytes()
            drum.chip.send(start + noise)
            drum.run(36 + int(dice.integers(0, 14)))
            drum.forces.clear()
        drum.run(20)
        after = drum.exchange(read)
        assert drum.steps().size == 0
        assert drum.state is State.IDLE
        return sum(a != b for a, b in zip(before, after, strict=True)), int(drum.x.resets)
