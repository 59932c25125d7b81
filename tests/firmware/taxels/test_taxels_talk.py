"""The taxel board's messages: identity, requests, resets, boot count."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from rigctl.bench.chips.simavr import ResetBy
from rigctl.boards.taxel_frames import IDENTIFY, encode_request
from tests.firmware.building import built
from tests.firmware.taxels.chip import TaxelChip

EEPROM_BYTES = 6
POWER_ON, EXTERNAL, WATCHDOG = 1, 2, 8


def test_identity_comes_first_after_power_up() -> None:
    with TaxelChip() as board:
        board.run(3)
        assert board.counters.size <= 2
        (identity,) = board.identities
        assert identity.board_id == 2 and identity.n_taxels == 18
        assert identity.boot_count == 1 and identity.reset_cause == POWER_ON
        assert identity.build_hash != 0


def test_an_identity_request_interrupts_no_frames() -> None:
    with TaxelChip() as board:
        board.run(30)
        for _ in range(10):
            board.chip.send(encode_request(IDENTIFY))
            board.run(7)
        assert len(board.identities) == 11
        assert np.all(np.diff(board.counters) == 1)


def test_noise_from_the_host_has_no_effect() -> None:
    noise = np.random.default_rng(1).integers(0, 256, 4000, np.uint8).tobytes()
    with TaxelChip() as board:
        board.run(30)
        board.chip.send(noise)
        board.run(120)
        board.chip.send(b"\0" + encode_request(IDENTIFY))
        board.run(5)
        assert len(board.identities) == 2
        assert np.all(np.diff(board.counters) == 1)
        assert not board.flags.any()
        assert board.x.rx_overruns == 0


def test_the_identity_has_reset_cause_and_boot_count() -> None:
    with TaxelChip() as board:
        board.run(30)
        for boots in range(2, 6):
            board.chip.reset(ResetBy.PIN)
            board.run(10)
            identity = board.identities[-1]
            assert (identity.boot_count, identity.reset_cause) == (boots, EXTERNAL)


@pytest.mark.parametrize("offset", range(EEPROM_BYTES))
def test_a_damaged_byte_of_eeprom_costs_at_most_one_boot(offset: int) -> None:
    with TaxelChip() as board:
        for _ in range(3):
            board.chip.reset(ResetBy.PIN)
            board.run(5)
        before = board.identities[-1].boot_count
        damaged = board.chip.read_eeprom(offset, 1)[0] ^ 0x40
        board.chip.write_eeprom(offset, bytes([damaged]))
        board.chip.reset(ResetBy.PIN)
        board.run(5)
        assert before <= board.identities[-1].boot_count <= before + 1


def test_the_cpp_tests_pass_under_sanitizers() -> None:
    done = subprocess.run(
        [built("firmware/native-taxels")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_hung_main_loop_is_restarted_and_reported() -> None:
    with TaxelChip("firmware/taxels-never-kick.elf") as hung:
        hung.run(1000)
        boots = [(i.boot_count, i.reset_cause) for i in hung.identities]
        assert boots[0] == (1, POWER_ON)
        assert boots[1:] == [(n + 2, WATCHDOG) for n in range(len(boots) - 1)]
        assert 13 <= len(boots) <= 16  # the watchdog resets after 64 ms
        assert hung.x.resets == len(boots) - 1
        assert hung.rejected <= len(boots)  # frames that the resets cut
