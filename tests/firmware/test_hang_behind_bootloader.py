"""A hang is known as one although the bootloader in front of the program clears MCUSR."""

from __future__ import annotations

import pytest

from rigctl.bench.chips.simavr import ResetBy
from rigctl.boards.drum_codes import ResetCause
from rigctl.boards.drum_states import Fault, State
from tests.firmware.bootloaders import MEGA, OLD_NANO, UNO
from tests.firmware.drum.support.checks import HANGS, hang_main_loop
from tests.firmware.drum.support.chip import DrumChip
from tests.firmware.taxels.chip import TaxelChip

WATCHDOG = 1 << ResetCause.WATCHDOG
BOOT_MS = 1000
"""A Mega's bootloader waits for 0.83 s."""


def cause_after_hang(image: str) -> tuple[int, State, Fault]:
    """Return cause, state and fault of a Mega after its main loop hung."""
    with DrumChip(image, MEGA) as drum:
        drum.run(BOOT_MS)
        assert (drum.get("boot_count"), drum.get("reset_cause")) == (1, 0)
        hang_main_loop(drum)
        drum.run(100)
        assert drum.x.resets == 1
        drum.run(BOOT_MS)
        assert drum.get("boot_count") == 2
        return drum.get("reset_cause"), drum.state, Fault(drum.get("fault"))


def test_a_hung_drum_says_so_behind_the_bootloader_of_a_mega() -> None:
    assert cause_after_hang(HANGS) == (WATCHDOG, State.FAULT_OFF, Fault.HANG)


def test_a_drum_that_forgets_is_caught() -> None:
    """The control: without the kept memory the cause is lost, as the bootloader clears it."""
    cause, _, fault = cause_after_hang("firmware/drum-forgets-hangs.elf")
    assert (cause, fault) == (0, Fault.NONE)


@pytest.mark.parametrize("by", [ResetBy.PIN, ResetBy.BROWN_OUT, ResetBy.POWER])
def test_other_resets_of_a_mega_are_no_hang(by: ResetBy) -> None:
    with DrumChip(bootloader=MEGA) as drum:
        drum.run(BOOT_MS)
        drum.chip.reset(by)
        drum.run(BOOT_MS)
        assert (drum.get("boot_count"), drum.get("reset_cause")) == (2, 0)
        assert drum.get("fault") == Fault.NONE


def causes(image: str) -> list[int]:
    """Return what the boots of an Uno whose program hangs again and again report."""
    with TaxelChip(image, UNO) as board:
        board.run(2500)
        boots = [identity.boot_count for identity in board.identities]
        assert boots == list(range(1, len(boots) + 1)) and len(boots) >= 3
        return [identity.reset_cause for identity in board.identities]


def test_a_hung_taxel_board_says_so_behind_optiboot() -> None:
    first, *others = causes("firmware/taxels-hangs.elf")
    assert first == 0 and set(others) == {WATCHDOG}


def test_a_taxel_board_that_forgets_is_caught() -> None:
    assert set(causes("firmware/taxels-forgets-hangs.elf")) == {0}


def test_the_old_bootloader_of_a_nano_restarts_for_ever_after_a_hang() -> None:
    """No firmware can survive it, because its program never runs: the documents name it."""
    with TaxelChip("firmware/taxels-never-kick.elf", OLD_NANO) as board:
        board.run(1500)
        assert [identity.boot_count for identity in board.identities] == [1]
        resets = board.x.resets
        board.run(2000)
        assert len(board.identities) == 1
        assert board.x.resets > resets + 50
        board.chip.reset(ResetBy.POWER)
        board.run(1500)
        assert board.identities[-1].boot_count == 2
