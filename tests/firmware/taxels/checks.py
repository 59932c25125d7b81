"""What the taxel board must do, as checks of an image, and the broken images that fail them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.firmware.taxels.chip import FRAME_CYCLES, SLOT_CYCLES, TaxelChip

Check = Callable[[str], None]
GOOD = "firmware/taxels.elf"
MILLISECONDS = 300
LEAST_FRAMES = MILLISECONDS - 20


def every_frame_has_the_next_number(image: str) -> None:
    """Counters go up by one, and the stream is one stream."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        assert board.counters.size > LEAST_FRAMES
        assert np.all(np.diff(board.counters) == 1)


def frames_begin_every_16000_cycles(image: str) -> None:
    """The first sample of each frame, for as long as it runs."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        starts = board.sampled(0)
        assert starts.size > LEAST_FRAMES
        drift = starts - starts[0] - FRAME_CYCLES * np.arange(starts.size)
        assert np.abs(drift).max() <= 1


def the_sample_times_do_not_move(image: str) -> None:
    """Every taxel at its slot to a cycle, both ends of each distance jittering by one."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        starts = board.sampled(0)[: board.sampled(17).size]
        assert starts.size > LEAST_FRAMES
        for taxel in range(18):
            offsets = board.sampled(taxel)[: starts.size] - starts - SLOT_CYCLES * taxel
            assert np.abs(offsets).max() <= 2, taxel


def no_frame_is_dropped(image: str) -> None:
    """What is sampled arrives."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        assert board.statuses[-1].frames_dropped == 0
        assert not board.flags.any()


def the_watchdog_does_not_fire(image: str) -> None:
    """The program says that it is alive, and so is never restarted."""
    with TaxelChip(image) as board:
        board.run(MILLISECONDS)
        assert board.x.resets == 0


CONTROLS: list[tuple[str, str, Check]] = [
    ("stuck-counter", "the frame counter does not advance", every_frame_has_the_next_number),
    ("never-clear", "the compare flag stays set", frames_begin_every_16000_cycles),
    ("by-software", "an interrupt starts conversions", the_sample_times_do_not_move),
    ("slow-wire", "250 kbaud for 33 bytes a millisecond", no_frame_is_dropped),
    ("never-kick", "the firmware never kicks the watchdog", the_watchdog_does_not_fire),
]
