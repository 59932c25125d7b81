"""Bad input on the taxel board's line changes nothing and delays no sample."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.boards.taxel_frames import BAUD, IDENTIFY, SELF_TEST, encode_request, frame
from tests.firmware.taxels.chip import BYTE_CYCLES, FRAME_CYCLES, SLOT_CYCLES, TaxelChip

EEPROM_BYTES = 1024
JITTER_CYCLES = 1


@pytest.fixture
def streaming() -> Iterator[TaxelChip]:
    """Yield a streaming board; afterwards check that the input has changed nothing."""
    with TaxelChip() as board:
        board.run(120)
        eeprom = board.chip.read_eeprom(0, EEPROM_BYTES)
        received = len(board.identities), len(board.tests)
        yield board
        board.run(120)
        assert (len(board.identities), len(board.tests)) == received
        assert board.chip.read_eeprom(0, EEPROM_BYTES) == eeprom
        assert board.x.resets == 0
        check_undisturbed(board)


def check_undisturbed(board: TaxelChip) -> None:
    """Check that no frame is missing or flagged, and that all samples are at their slots."""
    assert np.all(np.diff(board.counters) == 1)
    assert not board.flags.any()
    assert board.rejected == 0
    status = board.statuses[-1]
    assert status.frames_dropped == status.late_slots == 0
    whole = board.sampled(17).size
    starts = board.sampled(0)[:whole]
    assert np.abs(np.diff(starts) - FRAME_CYCLES).max() <= JITTER_CYCLES
    for taxel in range(18):
        offsets = board.sampled(taxel)[:whole] - starts - SLOT_CYCLES * taxel
        assert np.abs(offsets).max() <= JITTER_CYCLES, taxel


def received_bytes(data: bytes, sent_baud: float, read_baud: float = BAUD) -> bytes:
    """Return what a receiver at one baud rate decodes from 8N1 bytes sent at another.

    The bytes are sent without a pause. The receiver samples bits in their middles from each falling
    edge on, and like the chip's receiver it accepts a byte whose stop bit is low.
    """
    bits = np.array([b for byte in data for b in (0, *(byte >> i & 1 for i in range(8)), 1)])
    line = np.concatenate([[1], bits, np.ones(12, int)])
    ratio = sent_baud / read_baud
    got, at = bytearray(), 0.0
    while at * ratio < bits.size:
        place = int(at * ratio)
        if line[place + 1] == 1:
            at += 1 / 16
            continue
        middles = np.minimum(((at + 1.5 + np.arange(8)) * ratio).astype(int) + 1, line.size - 1)
        got.append(int((line[middles] << np.arange(8)).sum()))
        at += 9.6
    return bytes(got)


def test_the_receiver_model_decodes_bytes_at_its_own_rate() -> None:
    data = bytes(range(256))
    assert received_bytes(data, BAUD) == data
    assert received_bytes(data, BAUD * 1.02) == data
    assert received_bytes(data, BAUD / 2) != data


def test_garbage_at_full_speed(streaming: TaxelChip) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        streaming.chip.send(rng.integers(0, 256, 2000, np.uint8).tobytes())
        streaming.run(41)


@pytest.mark.parametrize("baud", [9_600, 57_600, 115_200, 230_400, 250_000, 1_000_000])
def test_a_host_at_another_baud_rate(streaming: TaxelChip, baud: int) -> None:
    requests = encode_request(IDENTIFY) + encode_request(SELF_TEST)
    received = received_bytes(requests * 12, baud)
    streaming.x.host_byte_q16 = max(BYTE_CYCLES, BYTE_CYCLES * BAUD // baud) << 16
    streaming.chip.send(received)
    streaming.run(len(requests) * 12 * 10_000 // baud + 20)


def test_damaged_truncated_and_unknown_requests(streaming: TaxelChip) -> None:
    request = encode_request(IDENTIFY)
    for bit in range(8 * (len(request) - 1)):
        bad = bytearray(request)
        bad[bit // 8] ^= 1 << bit % 8
        streaming.chip.send(bytes(bad) + b"\0")
        streaming.run(1)
    for length in range(len(request) - 1):
        streaming.chip.send(request[:length] + b"\0")
        streaming.run(1)
    for kind in (0x00, 0x03, 0x10, 0x11, 0x12, 0x13, 0xFF):
        streaming.chip.send(frame(bytes([kind])) + frame(bytes([IDENTIFY, kind])))
        streaming.run(2)


def test_an_incomplete_request_does_not_affect_the_next_one() -> None:
    with TaxelChip() as board:
        board.run(30)
        board.chip.send(encode_request(IDENTIFY)[:3])
        board.run(50)
        board.chip.send(b"\0" + encode_request(IDENTIFY))
        board.run(10)
        assert len(board.identities) == 2


def test_a_flood_of_requests_disturbs_no_sample() -> None:
    with TaxelChip() as board:
        board.run(120)
        for _ in range(200):
            board.chip.send(encode_request(IDENTIFY) * 4)
            board.run(1)
        board.run(100)
        assert len(board.identities) > 60
        check_undisturbed(board)
