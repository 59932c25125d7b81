"""The drum controller's image reacts to faults without the computer, on its chip."""

from __future__ import annotations

import random

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Input, Output, ResetBy
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import BY_NAME, MAGIC
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.checks import (
    ESTOP_LIMIT,
    HANGS,
    MOVING_STATES,
    enter_from_idle,
    hang_main_loop,
    open_emergency_stop,
)
from tests.firmware.drum.support.chip import MS, DrumChip, crc16


@pytest.mark.parametrize("state", MOVING_STATES)
def test_the_emergency_stop_acts_within_100_microseconds(state: State) -> None:
    with DrumChip() as drum:
        enter_from_idle(drum, state)
        open_emergency_stop(drum, 5000)
        assert drum.state is State.FAULT_OFF
        assert drum.get("fault") == Fault.ESTOP
        assert drum.command(Command.CLEAR) == 4
        drum.pin(Input.ESTOP, 0)
        drum.run(3)
        assert drum.command(Command.CLEAR) == 0
        assert drum.state is State.IDLE


def test_a_short_opening_of_the_emergency_stop_is_latched() -> None:
    with DrumChip() as drum:
        drum.arm()
        drum.pin(Input.ESTOP, 1, 3000)
        drum.pin(Input.ESTOP, 0, 3320)  # 20 µs, twice the longest spike
        drum.run(3)
        assert drum.get("fault") == Fault.ESTOP


def test_a_board_that_boots_with_an_open_emergency_stop_does_not_arm() -> None:
    with DrumChip() as drum:
        drum.pin(Input.ESTOP, 1)
        drum.run(1)
        drum.chip.reset(ResetBy.PIN)
        drum.run(200)
        assert drum.get("fault") == Fault.ESTOP
        assert drum.command(Command.ARM) == 4


def test_the_emergency_stop_works_with_a_hung_main_loop() -> None:
    with DrumChip(HANGS) as drum:
        drum.arm()
        drum.set("move_target", 100_000)
        drum.command(Command.MOVE)
        drum.poll_for(200)
        hang_main_loop(drum)
        drum.clear_edges()
        at = drum.pin(Input.ESTOP, 1, 2000)
        drum.run(2)
        assert drum.edges(Output.ENABLE)[0].tolist()[1] == 1
        assert drum.edges(Output.ENABLE)[0, 0] - at <= ESTOP_LIMIT
        assert not np.any(drum.steps() > at + ESTOP_LIMIT)


def test_over_force_lifts_within_two_milliseconds_of_its_second_sample() -> None:
    with DrumChip() as drum:
        drum.arm()
        drum.hold(1000)
        drum.rod_mm += 0.95  # to 1,570 g, but not deeper than a contact may go
        first = drum.x.loadcell_conversions
        while drum.x.drive > -0.9 and drum.x.loadcell_conversions < first + 5:
            drum.run(1)
        assert drum.x.loadcell_conversions - first in (2, 3)  # the first one may be half-way
        shown = drum.x.loadcell_ready - (drum.x.loadcell_period_q16 >> 16)
        assert 0 < drum.x.cycle - shown <= 2 * MS  # the tick checks it every ms
        assert drum.state is State.FAULT_LIFT
        assert drum.get("fault") == Fault.OVER_FORCE


@pytest.mark.parametrize(
    ("mode", "fault", "within_ms"),
    [(1, Fault.LOADCELL_SILENT, 46), (2, Fault.LOADCELL_FROZEN, 125)],
)
def test_a_failed_load_cell_lifts(mode: int, fault: Fault, within_ms: int) -> None:
    with DrumChip() as drum:
        enter_from_idle(drum, State.HOLD)
        drum.x.loadcell_mode = mode
        drum.run(within_ms)
        assert drum.state is State.FAULT_LIFT
        assert drum.get("fault") == fault


def test_fuzz_changes_no_setting_and_hangs_nothing() -> None:
    dice = random.Random(5)
    with DrumChip() as drum:
        before = [
            drum.get(name)
            for name in ("speed_set", "force_set", "over_force", "scale_ug_per_count")
        ]
        resets = drum.x.resets
        for _ in range(150):
            noise = bytearray(dice.randbytes(100))
            if dice.random() < 0.5:
                noise[:7] = bytes([1, 16, 0, BY_NAME["speed_set"].address, 0, 2, 4])
            drum.chip.send(bytes(noise))
            drum.run(10)
        drum.run(20)
        assert drum.get("magic") == MAGIC
        after = [
            drum.get(name)
            for name in ("speed_set", "force_set", "over_force", "scale_ug_per_count")
        ]
        assert after == before
        assert drum.x.resets == resets
        assert drum.state is State.IDLE


def test_split_requests_are_answered() -> None:
    with DrumChip() as drum:
        body = bytes([1, 3, 0, 0, 0, 1])
        frame = body + crc16(body)
        drum.chip.send(frame[:3])
        drum.run(5)
        assert drum.send_raw(frame[3:])[3:] == MAGIC.to_bytes(2, "big")
        assert drum.send_raw(frame[:4]) == b""
        drum.run(12)
        assert drum.send_raw(frame)[3:] == MAGIC.to_bytes(2, "big")


def test_saved_settings_survive_power_loss_and_a_damaged_slot() -> None:
    with DrumChip() as drum:
        boots = drum.get("boot_count")
        for value in (6100, 6200):
            drum.set("speed_set", value)
            assert drum.command(Command.SAVE, 2000) == 0
        drum.chip.reset(ResetBy.POWER)
        drum.run(250)
        assert drum.get("boot_count") == boots + 1
        assert drum.get("speed_set") == 6200
        slot = drum.chip.read_eeprom(64 + 128, 8)
        drum.chip.write_eeprom(64 + 128, bytes(b ^ 0xFF for b in slot))
        drum.chip.reset(ResetBy.POWER)
        drum.run(250)
        assert drum.get("speed_set") == 6100
        slot = drum.chip.read_eeprom(64, 8)
        drum.chip.write_eeprom(64, bytes(b ^ 0xFF for b in slot))
        drum.chip.reset(ResetBy.POWER)
        drum.run(250)
        assert drum.get("speed_set") == BY_NAME["speed_set"].default


def test_a_quarter_of_the_stack_is_never_used() -> None:
    with DrumChip() as drum:
        enter_from_idle(drum, State.RUN)
        assert drum.get("free_stack_bytes") > 0.25 * 8192
