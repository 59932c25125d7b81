"""The finger board's stream: any slicing gives the same values, damage costs what it touches."""

from __future__ import annotations

import struct
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.boards.taxel_frames import frame
from rigctl.encoder.force_gain import HIGHEST_GAIN, divided
from rigctl.encoder.normalisation import Normalisation
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.board_messages import (
    BATCH_SAMPLES,
    N_TAXELS,
    Answer,
    FingerSettings,
    RequestType,
    Result,
    decode_message,
    gain_crc,
)
from rigctl.finger.decoder import FingerBlock, FingerDecoder

LOW, HIGH = tuple(range(9)), tuple(range(900, 909))
GAIN = divided(Normalisation(np.array(LOW, np.uint16), np.array(HIGH, np.uint16)))


@pytest.fixture(scope="module")
def stream() -> bytes:
    """Bytes of two short scans, with settings and status frames."""
    rng = np.random.default_rng(3)
    board = FingerFirmware()
    board.boot(0)
    board.receive(board_messages.set_ranges(LOW, HIGH) + board_messages.read_settings())
    for scan in range(2):
        board.receive(board_messages.start(scan))
        for batch in range(2):
            board.run(rng.integers(0, 1024, (BATCH_SAMPLES, N_TAXELS), np.uint16))
            board.receive(board_messages.velocity(scan, batch, 80_000))
        board.receive(board_messages.stop(scan))
    sent = board.take_sent()
    board.close()
    return sent


def _values(pieces: list[tuple[FingerBlock, list[board_messages.Message]]]) -> tuple[object, ...]:
    blocks = [block for block, _ in pieces]
    arrays = (np.concatenate([block[i] for block in blocks]).tolist() for i in range(4))
    texts = [repr(message) for _, decoded in pieces for message in decoded]
    return (*arrays, sum(block.missing for block in blocks), texts)


@given(cuts=st.lists(st.integers(0, 1 << 16), max_size=12))
@settings(deadline=None, max_examples=50)
def test_any_slicing_gives_the_same_values(stream: bytes, cuts: list[int]) -> None:
    decoder = FingerDecoder()
    edges = [0, *sorted(cut % (len(stream) + 1) for cut in cuts), len(stream)]
    pieces = [decoder.feed(stream[a:b]) for a, b in pairwise(edges)]
    assert _values(pieces) == _values([FingerDecoder().feed(stream)])
    assert decoder.damaged == 0


@given(at=st.integers(0, 1 << 16), bit=st.integers(0, 7))
@settings(deadline=None, max_examples=200)
def test_a_flipped_bit_never_changes_a_value(stream: bytes, at: int, bit: int) -> None:
    """It costs the frames that it touches; a lost sample is counted as missing."""
    damaged = bytearray(stream)
    damaged[at % len(stream)] ^= 1 << bit
    whole, expected = FingerDecoder().feed(stream)
    decoder = FingerDecoder()
    block, decoded = decoder.feed(bytes(damaged))
    assert decoder.damaged <= 2
    rows = np.searchsorted(whole.counters, block.counters)
    for i in range(4):
        assert np.array_equal(block[i], whole[i][rows])
    assert len(whole.counters) - len(block.counters) in (0, 1, 2)
    assert set(map(repr, decoded)) <= set(map(repr, expected))


def test_an_endless_chunk_costs_no_memory_and_the_next_frame_is_whole(stream: bytes) -> None:
    decoder = FingerDecoder()
    for _ in range(100):
        decoder.feed(b"\x55" * 10_000)
    assert len(decoder._tail) < 100
    block, _ = decoder.feed(b"\0" + stream)
    assert len(block.counters) == 4 * BATCH_SAMPLES
    assert decoder.damaged == 1


def test_unknown_types_sizes_and_codes_are_no_messages() -> None:
    assert decode_message(b"\x7f1234") is None
    assert decode_message(b"\x37123") is None
    answer = struct.pack("<BBBI", 0x34, RequestType.START, 99, 1)
    assert decode_message(answer) is None


def _answers(board: FingerFirmware) -> list[Result]:
    _, decoded = FingerDecoder().feed(board.take_sent())
    return [message.result for message in decoded if isinstance(message, Answer)]


def test_the_board_refuses_impossible_settings_whole() -> None:
    board = FingerFirmware()
    board.boot(0)
    board.receive(board_messages.set_ranges(LOW, HIGH))
    board.receive(board_messages.set_ranges((*LOW[:8], 1000), (*HIGH[:8], 999)))
    for reference in (0, 999, 10_000_001, 0xFFFFFFFF):
        board.receive(board_messages.set_reference(reference))
    assert _answers(board) == [Result.OK] + [Result.WRONG_VALUE] * 5
    for gain in (replace(GAIN, shift=17), replace(GAIN, gains=(HIGHEST_GAIN + 1,) * 65)):
        board.receive(board_messages.set_gain(gain))
        assert _answers(board) == [Result.WRONG_VALUE] * board_messages.GAIN_PARTS
    board.receive(board_messages.set_gain(GAIN))
    assert _answers(board) == [Result.OK] * board_messages.GAIN_PARTS
    board.receive(board_messages.start(1) + board_messages.set_ranges(HIGH, HIGH))
    board.receive(board_messages.set_gain(board_messages.NO_GAIN))
    board.receive(board_messages.set_reference(5000))
    board.receive(board_messages.velocity(1, 0, 10_000_001))
    assert _answers(board) == [*(Result.OK, *[Result.SCANNING] * 7, Result.WRONG_VALUE)]
    board.receive(board_messages.read_settings())
    _, decoded = FingerDecoder().feed(board.take_sent())
    assert decoded == [FingerSettings(LOW, HIGH, 100_000, gain_crc(GAIN))]
    board.close()


@given(noise=st.binary(max_size=400))
@settings(deadline=None, max_examples=200)
def test_noise_on_the_line_changes_no_setting_and_starts_no_scan(noise: bytes) -> None:
    board = FingerFirmware()
    board.boot(0)
    board.receive(noise + b"\0" + frame(b"\x99") + board_messages.read_settings())
    board.run(np.full((BATCH_SAMPLES, N_TAXELS), 500, np.uint16))
    block, decoded = FingerDecoder().feed(board.take_sent())
    assert FingerSettings((0,) * 9, (1023,) * 9, 100_000) in decoded
    assert not np.any(block.flags)
    board.close()
