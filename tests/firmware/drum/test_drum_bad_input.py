"""Bad input on the drum's line gets an exception or no reply, moves nothing, and saves nothing."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Output
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import (
    BY_NAME,
    END,
    MAGIC,
    REGISTERS,
    SETTINGS,
    SETTINGS_BLOCK,
    Register,
    pack_value,
)
from rigctl.boards.drum_states import Fault, State
from tests.benchmarks.firmware._drum_wire import POLLS_S, fuzz, soak
from tests.firmware.drum.support.checks import enter_from_idle
from tests.firmware.drum.support.chip import DrumChip, crc16

EEPROM_BYTES = 1024
NO_FUNCTION, NO_REGISTER, BAD_VALUE, REFUSED = 1, 2, 3, 4
FRAME_BAUD, BITS = 115_200, 10
LIMITS = {"u16": (0, 0xFFFF), "i16": (-0x8000, 0x7FFF), "i32": (-(2**31), 2**31 - 1)}


class Snapshot:
    """Settings and EEPROM of a drum, to check that input changes and drives nothing."""

    def __init__(self, drum: DrumChip) -> None:
        self.drum = drum
        self.before = self._read()
        drum.clear_edges()

    def _read(self) -> tuple[bytes, bytes]:
        settings = self.drum.exchange(struct.pack(">BHH", 3, *SETTINGS_BLOCK))
        return settings, self.drum.chip.read_eeprom(0, EEPROM_BYTES)

    def check_unchanged(self) -> None:
        """Check that nothing has changed or moved."""
        assert self._read() == self.before
        assert self.drum.state is State.IDLE
        assert self.drum.steps().size == 0
        for signal in (Output.ENABLE, Output.BRIDGE):
            assert self.drum.edges(signal).size == 0
        assert self.drum.x.resets == 0


@pytest.fixture
def idle() -> Iterator[DrumChip]:
    """Yield a drum in IDLE; afterwards check that nothing has changed or moved."""
    with DrumChip() as drum:
        drum.run(60)
        snapshot = Snapshot(drum)
        yield drum
        drum.run(30)
        snapshot.check_unchanged()


def values_out_of_bounds(register: Register) -> list[int]:
    """Return values outside of a register's bounds that fit in its words."""
    least, most = LIMITS[register.kind]
    values = (register.low - 1, register.high + 1, least, most)
    return sorted(
        {v for v in values if not register.low <= v <= register.high and least <= v <= most}
    )


def test_a_value_out_of_bounds_is_refused_whole(idle: DrumChip) -> None:
    for register in SETTINGS:
        for value in values_out_of_bounds(register):
            words = pack_value(register, value)
            assert idle.write(register.address, *words) == BAD_VALUE, (register.name, value)
    good, bad = BY_NAME["speed_set"], BY_NAME["force_set"]
    assert bad.address == good.address + 1
    assert idle.write(good.address, 6000, bad.high + 1) == BAD_VALUE
    both = struct.pack(">BHHHHBH", 23, 16, 40, bad.address, 1, 2, bad.high + 1)
    assert idle.exchange(both)[1:3] == bytes([0x80 | 23, BAD_VALUE])
    one = struct.pack(">BHH", 6, bad.address, bad.high + 1)
    assert idle.exchange(one)[1:3] == bytes([0x80 | 6, BAD_VALUE])


def test_writes_of_read_only_and_missing_registers_are_refused(idle: DrumChip) -> None:
    for register in (r for r in REGISTERS if not r.writable):
        assert idle.write(register.address, 1) == NO_REGISTER, register.name
    wide = BY_NAME["move_target"]
    for address in (67, wide.end, END, 0xFFFF):
        if not any(r.writable and r.address <= address < r.end for r in SETTINGS):
            assert idle.write(address, 1) == NO_REGISTER, address
    assert idle.exchange(struct.pack(">BHH", 3, END, 1))[2] == NO_REGISTER
    assert idle.exchange(struct.pack(">BHH", 3, 0xFFFF, 2))[2] == NO_REGISTER
    assert idle.exchange(struct.pack(">BHH", 3, 0, 0))[2] == BAD_VALUE
    assert idle.exchange(struct.pack(">BHH", 3, 0, 126))[2] == BAD_VALUE


def test_a_command_in_the_wrong_state_is_refused(idle: DrumChip) -> None:
    for command in (Command.MOVE, Command.APPROACH, Command.RUN, Command.RETRACT, Command.CLEAR):
        assert idle.command(command) == REFUSED


def test_split_and_joined_requests_are_answered_or_dropped(idle: DrumChip) -> None:
    body = bytes([1, 3, 0, 0, 0, 1])
    frame = body + crc16(body)
    for cut in range(1, len(frame)):
        assert idle.send_raw(frame[:cut]) == b""  # 40 ms of silence discard it
        assert idle.send_raw(frame)[3:] == MAGIC.to_bytes(2, "big")
    idle.chip.send(frame[:3])
    idle.run(5)
    assert idle.send_raw(frame[3:])[3:] == MAGIC.to_bytes(2, "big")
    idle.chip.send(frame + frame)
    idle.run(20)
    assert idle.get("frames_seen") >= 2 + len(frame)


def test_a_repeated_frame_is_executed_once() -> None:
    with DrumChip() as drum:
        drum.arm()
        head = struct.pack(">BBHHBHH", 1, 16, 65, 2, 4, Command.MOVE, 500)
        frame = head + crc16(head)
        drum.set("move_target", 640)
        drum.clear_edges()
        drum.send_raw(frame)
        drum.poll_for(600)
        for _ in range(3):
            drum.send_raw(frame)
            drum.poll_for(40)
        assert drum.steps().size == 640
        beat = struct.pack(">BBHHHHBH", 1, 23, 16, 40, 64, 1, 2, 4711)
        for _ in range(20):  # the board ignores a heartbeat that does not change
            drum.send_raw(beat + crc16(beat))
            drum.run(10)
        assert drum.get("fault") == Fault.HEARTBEAT


def test_a_host_that_dies_in_the_middle_of_a_write_stops_the_drum() -> None:
    with DrumChip() as drum:
        enter_from_idle(drum, State.RUN)
        before = drum.get("over_force"), drum.get("force_set")
        eeprom = drum.chip.read_eeprom(0, EEPROM_BYTES)
        head = struct.pack(">BBHHBHH", 1, 16, BY_NAME["speed_set"].address, 2, 4, 4000, 9000)
        drum.chip.send((head + crc16(head))[:9])
        drum.run(1200)
        assert drum.force_g == 0
        assert drum.x.drive == 0
        assert drum.get("fault") == Fault.HEARTBEAT
        assert (drum.get("over_force"), drum.get("force_set")) == before
        assert drum.get("speed_set") == BY_NAME["speed_set"].default
        assert drum.chip.read_eeprom(0, EEPROM_BYTES) == eeprom


def received_bytes(data: bytes, baud: int) -> bytes:
    """Return what a receiver at 115,200 baud decodes from bytes sent at another rate."""
    bits = [b for byte in data for b in (0, *(byte >> n & 1 for n in range(8)), 1)] + [1] * 40
    length = len(bits) * FRAME_BAUD / baud
    out, at = bytearray(), 0.0

    def level(place: float) -> int:
        return bits[min(int(place * baud / FRAME_BAUD), len(bits) - 1)]

    while at < length:
        if level(at):
            at += 0.1
            continue
        out.append(sum(level(at + 1.5 + n) << n for n in range(8)))
        at += BITS - 0.4
    return bytes(out)


def test_the_receiver_model_decodes_bytes_at_its_own_rate() -> None:
    data = bytes(range(256))
    assert received_bytes(data, FRAME_BAUD) == data


@pytest.mark.parametrize("baud", [9600, 38_400, 57_600, 230_400, 500_000])
def test_another_baud_rate_does_nothing(idle: DrumChip, baud: int) -> None:
    armed = struct.pack(">BBHHBHHH", 1, 16, 64, 3, 6, 1, Command.ARM, 77)
    limits = struct.pack(">BBHHBH", 1, 16, BY_NAME["over_force"].address, 1, 2, 30_000)
    for body in (armed, limits) * 3:
        idle.chip.send(received_bytes(body + crc16(body), baud))
        idle.run(40)


def test_noise_that_begins_like_a_request_does_nothing(idle: DrumChip) -> None:
    dice = np.random.default_rng(11)
    heads = (b"\x01\x10\x00\x40", b"\x01\x06\x00\x45", b"\x01\x17\x00\x10", b"\x01\x03")
    for n in range(200):
        noise = dice.integers(0, 256, 60, np.uint8).tobytes()
        idle.chip.send(heads[n % len(heads)] + noise)
        idle.run(int(dice.integers(3, 16)))


SOAK_S = 15
FUZZ_BYTES = 30_000


def test_every_poll_is_answered_in_time() -> None:
    polls, missed, slowest_us = soak(SOAK_S)
    assert polls >= 0.99 * SOAK_S * POLLS_S
    assert missed == 0
    assert slowest_us < 5000


def test_noise_changes_no_register_and_restarts_nothing() -> None:
    assert fuzz(FUZZ_BYTES) == (0, 0)
