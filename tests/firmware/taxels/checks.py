"""Checks of an image of the taxel board, and the broken images that must fail them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.firmware.taxels.chip import FRAME_CYCLES, SLOT_CYCLES, TaxelChip

Check = Callable[[str], None]
MILLISECONDS = 300
LEAST_FRAMES = MILLISECONDS - 20


def frame_counters_are_consecutive(image: str) -> None:
    """Counters increase by one."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        assert board.counters.size > LEAST_FRAMES
        assert np.all(np.diff(board.counters) == 1)


def frames_begin_every_16000_cycles(image: str) -> None:
    """The times of the first samples do not drift."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        starts = board.sampled(0)
        assert starts.size > LEAST_FRAMES
        drift = starts - starts[0] - FRAME_CYCLES * np.arange(starts.size)
        assert np.abs(drift).max() <= 1


def sample_times_are_constant(image: str) -> None:
    """Every taxel is sampled in its slot; both ends of an interval jitter by one cycle."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        starts = board.sampled(0)[: board.sampled(17).size]
        assert starts.size > LEAST_FRAMES
        for taxel in range(18):
            offsets = board.sampled(taxel)[: starts.size] - starts - SLOT_CYCLES * taxel
            assert np.abs(offsets).max() <= 2, taxel


def no_frame_is_dropped(image: str) -> None:
    """Every sampled frame is received."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        assert board.statuses[-1].frames_dropped == 0
        assert not board.flags.any()


def the_watchdog_does_not_fire(image: str) -> None:
    """The program kicks the watchdog in time."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        assert board.x.resets == 0


CONTROLS: list[tuple[str, str, Check]] = [
    ("stuck-counter", "the frame counter does not advance", frame_counters_are_consecutive),
    ("never-clear", "the compare flag stays set", frames_begin_every_16000_cycles),
    ("by-software", "an interrupt starts conversions", sample_times_are_constant),
    ("slow-wire", "250 kbaud for 33 bytes a millisecond", no_frame_is_dropped),
    ("never-kick", "the firmware never kicks the watchdog", the_watchdog_does_not_fire),
]
