"""The drum's Modbus: standard exceptions, silence for other units, no partial writes."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.bench.virtual_rig import open_virtual_rig
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import END
from tests.bench.host import Host, Refused, crc, framed


@pytest.fixture(scope="module")
def host() -> Host:
    host = Host(open_virtual_rig(seed=0))
    host.wait(200_000)
    return host


def test_crc_of_the_standards_example() -> None:
    assert crc(bytes([0x02, 0x07])) == 0x1241  # Modbus over serial line V1.02, §6.2.2


@pytest.mark.parametrize("function", [1, 2, 4, 5, 15, 22, 43, 99])
def test_unknown_functions_get_exception_1(host: Host, function: int) -> None:
    answer = host.ask(framed(bytes([1, function, 0, 0, 0, 1])))
    assert answer[1:3] == bytes([function | 0x80, 1])


@pytest.mark.parametrize(("address", "count"), [(END, 1), (END - 1, 2), (65535, 125)])
def test_addresses_that_do_not_exist_get_exception_2(host: Host, address: int, count: int) -> None:
    with pytest.raises(Refused, match="exception 2"):
        host.read(address, count)


def test_addresses_between_the_entries_read_zero_and_refuse_writes(host: Host) -> None:
    assert host.read(14, 2) == (0, 0)
    with pytest.raises(Refused, match="exception 2"):
        host.write(115, 1)
    with pytest.raises(Refused, match="exception 2"):
        host.write(16, 3)


@pytest.mark.parametrize("count", [0, 126])
def test_counts_out_of_range_get_exception_3(host: Host, count: int) -> None:
    with pytest.raises(Refused, match="exception 3"):
        host.read(0, count)


def test_a_value_out_of_range_changes_nothing_of_its_write(host: Host) -> None:
    before = host.read(68, 2)
    with pytest.raises(Refused, match="exception 3"):
        host.write(68, 6000, 49)
    assert host.read(68, 2) == before


def test_a_refused_command_changes_nothing_of_its_write(host: Host) -> None:
    before = host.read(64, 3)
    with pytest.raises(Refused, match="exception 4"):
        host.write(64, before[0] + 1, Command.RUN, before[2] + 1)
    assert host.read(64, 3) == before


def test_the_same_sequence_executes_nothing(host: Host) -> None:
    sequence = host.get("command_sequence")
    host.write(65, Command.RUN, sequence)
    assert host.get("state") == 2


def test_function_6_and_a_wide_value(host: Host) -> None:
    assert host.ask(framed(struct.pack(">BBHH", 1, 6, 70, 500)))[:2] == bytes([1, 6])
    assert host.get("acceleration_set") == 500
    host.put("move_target", -123456)
    assert host.get("move_target") == -123456


def test_function_23_writes_before_it_reads(host: Host) -> None:
    body = struct.pack(">BBHHHHBH", 1, 23, 69, 1, 69, 1, 2, 3330)
    assert host.ask(framed(body))[3:5] == struct.pack(">H", 3330)


def test_other_units_and_broadcasts_get_silence(host: Host) -> None:
    for unit in (0, 2, 247):
        assert host.ask(framed(struct.pack(">BBHH", unit, 3, 0, 1))) == b""


def test_a_bad_crc_gets_silence_and_is_counted(host: Host) -> None:
    before = host.poll()["crc_errors"]
    assert host.ask(struct.pack(">BBHHH", 1, 3, 0, 1, 0xABCD)) == b""
    assert host.poll()["crc_errors"] == before + 1


def test_a_split_frame_is_served_and_10_ms_of_silence_begin_a_new_one(host: Host) -> None:
    request = framed(struct.pack(">BBHH", 1, 3, 0, 1))
    host.simulation.drum.write(request[:3])
    host.wait(5_000)
    assert host.ask(request[3:])[3:5] == b"RG"
    host.simulation.drum.write(request[:3])
    host.wait(15_000)
    assert host.ask(request)[3:5] == b"RG"


def test_the_reply_starts_within_2_ms_and_takes_its_byte_times(host: Host) -> None:
    begun = host.simulation.time_us
    host.read(16, 40)
    wire_us = (8 + 85) * 10 / 115200 * 1e6
    assert wire_us < host.simulation.time_us - begun < wire_us + 2_000


@settings(max_examples=60, deadline=None)
@given(st.binary(min_size=1, max_size=200))
def test_noise_changes_no_setting_and_does_not_block(host: Host, data: bytes) -> None:
    before = host.read(64, 32)
    host.simulation.drum.write(data)
    host.wait(40_000)
    assert host.read(64, 32) == before
