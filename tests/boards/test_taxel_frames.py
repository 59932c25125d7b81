"""The taxel stream: any slicing gives the same samples, and every loss is counted."""

from __future__ import annotations

import zlib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.boards import taxel_frames as taxels
from rigctl.boards.drum_registers import BOARD_TAXELS, MAGIC
from rigctl.boards.taxel_decoder import Decoded, FrameDecoder
from rigctl.boards.taxel_frames import Flag, cobs_encode
from rigctl.values import Block
from tests.boards import taxel_encoder
from tests.boards.taxel_encoder import cobs_decode

IDENTITY = taxels.TaxelIdentity(
    *(MAGIC, taxels.WIRE_VERSION, BOARD_TAXELS, 0x0102, 0xDEADBEEF),
    *(18, 1000, 7, 2, 800, 20),
)
STATUS = taxels.TaxelStatus(0, 0, 1, 320, 5012, 2, 7, 900, 480, 3, 8)

DROPS_SHIFT = 4
"""Flags hold the count of dropped frames from this bit on."""


def stream(counters: NDArray[np.int64], seed: int = 1) -> bytes:
    return taxel_encoder.encode_data(counters, *readings(counters, seed))


def readings(
    counters: NDArray[np.int64], seed: int = 1
) -> tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.uint8]]:
    """Samples, flags and edges that follow from the counter alone."""
    rng = np.random.default_rng(seed)
    table = rng.integers(0, 1024, (997, 18)).astype(np.uint16)
    samples = np.ascontiguousarray(table[counters % 997])
    flags = (samples[:, 0] & 3).astype(np.uint8)
    return samples, flags, (samples[:, 1] & 15).astype(np.uint8)


def decode_slices(wire: bytes, cuts: list[int]) -> tuple[list[Decoded], FrameDecoder]:
    decoder = FrameDecoder(18)
    edges = [0, *sorted(c % (len(wire) + 1) for c in cuts), len(wire)]
    return [decoder.feed(wire[a:b], 0.0) for a, b in pairwise(edges)], decoder


def joined(pieces: list[Decoded]) -> tuple[object, ...]:
    """Everything that must not depend on how the bytes were sliced."""
    blocks = [b for p in pieces for b in p.blocks]
    return (
        [int(c) for b in blocks for c in b.counters],
        [s.tobytes() for b in blocks for s in b.samples],
        [int(f) for b in blocks for f in b.flags],
        [int(e) for b in blocks for e in b.edges],
        [g for b in blocks for g in b.gaps],
        [s for p in pieces for s in p.statuses],
        [i for p in pieces for i in p.identities],
        sum(p.reboots for p in pieces),
        sum(p.rejected_frames for p in pieces),
        sum(p.rejected_bytes for p in pieces),
    )


def only(pieces: list[Decoded]) -> Block:
    blocks = [b for p in pieces for b in p.blocks]
    assert len(blocks) == 1
    return blocks[0]


def test_a_frame_has_33_bytes_and_zlibs_crc() -> None:
    wire = stream(np.arange(1))
    assert len(wire) == taxels.frame_bytes(18) == 33
    body = taxel_encoder.unframe(wire[:-1])
    assert body is not None
    assert body[0] == 0x11
    assert wire == taxels.frame(body)
    assert zlib.crc32(body) != 0


@given(st.integers(0, 2**31), st.integers(1, 40), st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_encoded_frames_are_restored(first: int, n: int, seed: int) -> None:
    counters = np.arange(first, first + n)
    samples, flags, edges = readings(counters, seed)
    block = only(
        [FrameDecoder(18).feed(taxel_encoder.encode_data(counters, samples, flags, edges), 1.5)]
    )
    np.testing.assert_array_equal(block.counters % 65536, counters % 65536)
    np.testing.assert_array_equal(np.diff(block.counters), 1)
    np.testing.assert_array_equal(block.samples, samples)
    np.testing.assert_array_equal(block.flags, flags)
    np.testing.assert_array_equal(block.edges, edges)
    assert block.gaps == ()
    assert block.arrived_s == 1.5


def test_status_identity_and_requests_come_back() -> None:
    decoded = FrameDecoder(18).feed(
        taxel_encoder.encode_identity(IDENTITY) + taxel_encoder.encode_status(STATUS), 0.0
    )
    assert decoded.identities == (IDENTITY,)
    assert decoded.statuses == (STATUS,)
    assert decoded.blocks == ()
    assert taxel_encoder.unframe(taxels.encode_request(taxels.IDENTIFY)[:-1]) == b"\x01"


pieces_of_a_stream = st.lists(
    st.one_of(st.just("data"), st.just("status"), st.just("identity"), st.binary(max_size=90)),
    max_size=30,
)


@given(pieces_of_a_stream, st.lists(st.integers(0, 3000), max_size=30))
def test_any_slicing_gives_the_same(parts: list[str | bytes], cuts: list[int]) -> None:
    wire = b""
    for i, part in enumerate(parts):
        if part == "data":
            wire += stream(np.arange(3 * i, 3 * i + 2))
        elif part == "status":
            wire += taxel_encoder.encode_status(replace(STATUS, sample_counter=3 * i + 2))
        elif part == "identity":
            wire += taxel_encoder.encode_identity(IDENTITY)
        elif isinstance(part, bytes):
            wire += part
    whole, _ = decode_slices(wire, [])
    sliced, _ = decode_slices(wire, cuts)
    assert joined(sliced) == joined(whole)


@given(st.integers(1, 30), st.binary(max_size=200), st.data())
def test_garbage_costs_only_the_frames_it_touches(
    n: int, garbage: bytes, data: st.DataObject
) -> None:
    wire = bytearray(stream(np.arange(n)))
    at = data.draw(st.integers(0, len(wire)))
    overwritten = data.draw(st.integers(0, 100))
    touched = range(max(at - 1, 0) // 33, -(-min(at + overwritten + 1, len(wire)) // 33))
    wire[at : at + overwritten] = garbage
    pieces, _ = decode_slices(bytes(wire), [])
    counters = [int(c) for p in pieces for b in p.blocks for c in b.counters]
    assert set(range(n)) - set(touched) <= set(counters) <= set(range(n))


@given(st.lists(st.booleans(), min_size=2, max_size=300), st.integers(0, 2**20))
def test_every_lost_sample_is_counted(kept: list[bool], first: int) -> None:
    kept = [True, *kept, True]
    counters = np.flatnonzero(kept) + first
    decoder = FrameDecoder(18)
    decoder.feed(taxel_encoder.encode_status(replace(STATUS, sample_counter=first)), 0.0)
    block = only([decoder.feed(stream(counters), 0.0)])
    lost = [i for g in block.gaps for i in range(g.first_counter, g.first_counter + g.count)]
    np.testing.assert_array_equal(block.counters, counters)
    assert lost == [first + i for i, keep in enumerate(kept) if not keep]


def test_a_gap_says_who_lost_the_samples() -> None:
    counters = np.array([0, 1, 4, 5, 9])
    samples, flags, edges = readings(counters)
    flags = np.array([0, 0, 2, 2, 2], np.uint8) << DROPS_SHIFT
    block = only(
        [FrameDecoder(18).feed(taxel_encoder.encode_data(counters, samples, flags, edges), 0.0)]
    )
    assert [(g.first_counter, g.count, g.reason) for g in block.gaps] == [
        (2, 2, "dropped by the board"),
        (6, 3, "lost on the line"),
    ]


def test_the_counter_runs_on_across_the_wrap_of_its_16_bits_with_status_frames_between() -> None:
    decoder = FrameDecoder(18)
    seen: list[int] = []
    for first in range(0, 140_000, 100):
        wire = stream(np.arange(first, first + 100))
        wire += taxel_encoder.encode_status(replace(STATUS, sample_counter=first + 100))
        decoded = decoder.feed(wire, 0.0)
        assert decoded.reboots == 0
        (block,) = decoded.blocks
        assert block.gaps == ()
        seen += [int(block.counters[0]), int(block.counters[-1])]
    assert seen == [c for f in range(0, 140_000, 100) for c in (f, f + 99)]


def test_a_long_silence_is_counted_through_the_status_frame() -> None:
    decoder = FrameDecoder(18)
    decoder.feed(stream(np.arange(1000)), 0.0)
    decoder.resync()
    assert decoder.waiting
    assert decoder.feed(stream(np.arange(200_000, 200_020)), 200.0).blocks == ()
    decoder.feed(taxel_encoder.encode_status(replace(STATUS, sample_counter=200_020)), 200.0)
    block = only([decoder.feed(stream(np.arange(200_020, 200_040)), 200.0)])
    assert block.counters[0] == 200_020
    assert [(g.first_counter, g.count) for g in block.gaps] == [(1000, 199_020)]


@pytest.mark.parametrize("counter", [0, 70_000, 2**31 + 5, 2**32 - 60])
def test_joining_a_running_stream_waits_for_the_whole_counter(counter: int) -> None:
    decoder = FrameDecoder(18)
    decoder.resync()
    torn = stream(np.arange(counter, counter + 1))[20:]
    assert decoder.feed(torn + stream(np.arange(counter + 1, counter + 50)), 0.0).blocks == ()
    status = taxel_encoder.encode_status(replace(STATUS, sample_counter=counter + 50))
    decoded = decoder.feed(status + stream(np.arange(counter + 50, counter + 150)), 0.0)
    block = only([decoded])
    np.testing.assert_array_equal(block.counters, np.arange(counter + 50, counter + 150))
    assert (decoded.rejected_frames, decoded.reboots, block.gaps) == (0, 0, ())


def test_the_32_bits_of_the_status_counter_wrap_too() -> None:
    decoder = FrameDecoder(18)
    decoder.resync()
    first = 2**32 - 150
    decoder.feed(taxel_encoder.encode_status(replace(STATUS, sample_counter=first)), 0.0)
    for start in range(first, first + 400, 100):
        wire = stream(np.arange(start, start + 100))
        status = replace(STATUS, sample_counter=(start + 100) % 2**32)
        block = only([decoder.feed(wire + taxel_encoder.encode_status(status), 0.0)])
        assert (block.counters[0], block.gaps) == (start, ())


@pytest.mark.parametrize("told_by", ["identity", "status"])
def test_a_reboot_is_reported_and_restarts_the_counter(told_by: str) -> None:
    wire = taxel_encoder.encode_identity(IDENTITY) + stream(np.arange(300))
    if told_by == "identity":
        wire += taxel_encoder.encode_identity(replace(IDENTITY, boot_count=8))
    elif told_by == "status":
        wire += taxel_encoder.encode_status(replace(STATUS, boot_count=8))
    pieces, _ = decode_slices(wire + stream(np.arange(50)), [])
    before, after = pieces[-1].blocks
    assert pieces[-1].reboots == 1
    assert before.counters[-1] == 299
    np.testing.assert_array_equal(after.counters, np.arange(50))
    assert before.gaps == after.gaps == ()


@pytest.mark.parametrize("boot_count", [8, 7])
@pytest.mark.parametrize("ran", [300, 65_400])
def test_a_reboot_whose_identity_is_lost_is_told_by_the_statuses(boot_count: int, ran: int) -> None:
    """Its samples until then look like repeats, or like a gap across the wrap of 16 bits.

    A board that cannot count its boots is known by a second status that is behind, too.
    """
    status = replace(STATUS, boot_count=7, sample_counter=ran)
    wire = taxel_encoder.encode_identity(IDENTITY) + stream(np.arange(ran))
    wire += taxel_encoder.encode_status(status) + stream(np.arange(60))
    for first in (60, 160):
        wire += taxel_encoder.encode_status(
            replace(status, boot_count=boot_count, sample_counter=first)
        )
        wire += stream(np.arange(first, first + 100))
    (decoded,), _ = decode_slices(wire, [])
    before, after = decoded.blocks
    assert (decoded.reboots, before.counters[-1]) == (1, ran - 1)
    np.testing.assert_array_equal(after.counters, np.arange(60 if boot_count == 8 else 160, 260))
    assert before.gaps == after.gaps == ()


def test_repeated_and_late_frames_are_no_reboot_and_a_late_one_stays_a_gap() -> None:
    one = [stream(np.arange(i, i + 1)) for i in range(8)]
    status = taxel_encoder.encode_status(replace(STATUS, sample_counter=3))
    wire = b"".join([*one[:3], status, one[2], one[4], status, one[3], *one[5:]])
    decoded = FrameDecoder(18).feed(wire + taxel_encoder.encode_identity(IDENTITY) * 2, 0.0)
    block = only([decoded])
    assert block.counters.tolist() == [0, 1, 2, 4, 5, 6, 7]
    assert [(gap.first_counter, gap.count) for gap in block.gaps] == [(3, 1)]
    assert (decoded.reboots, decoded.stale_frames, decoded.rejected_frames) == (0, 2, 0)


def test_a_status_of_the_boot_before_changes_nothing() -> None:
    old = taxel_encoder.encode_status(replace(STATUS, sample_counter=300, boot_count=7))
    wire = taxel_encoder.encode_identity(IDENTITY) + stream(np.arange(301))
    wire += taxel_encoder.encode_identity(replace(IDENTITY, boot_count=8)) + old
    decoded = FrameDecoder(18).feed(wire + stream(np.arange(300, 303)) + stream(np.arange(50)), 0.0)
    assert [len(block) for block in decoded.blocks] == [301, 50]
    assert (decoded.reboots, decoded.stale_frames, decoded.statuses) == (1, 4, ())


def test_flags_and_edge_counts_have_the_places_of_the_reference() -> None:
    counters = np.arange(1)
    samples = np.zeros((1, 18), np.uint16)
    flags = np.array([Flag.SYNC | Flag.LATE | 3 << DROPS_SHIFT], np.uint8)
    edges = np.array([0b0110], np.uint8)
    body = taxel_encoder.unframe(taxel_encoder.encode_data(counters, samples, flags, edges)[:-1])
    assert body is not None
    assert (body[3], body[26]) == (0x35, 0b0110_0000)


def test_an_endless_stream_without_zero_keeps_no_memory_and_is_counted() -> None:
    decoder = FrameDecoder(18)
    decoder.feed(stream(np.arange(5)), 0.0)
    for _ in range(50):
        decoder.feed(b"\x55" * 1000, 0.0)
    decoded = decoder.feed(b"\x55" + stream(np.arange(5, 10)), 0.0)
    assert (decoded.rejected_frames, decoded.rejected_bytes) == (1, 50_001)
    assert len(only([decoded])) == 5
    assert only([decoded]).gaps == ()


def damaged(rng: np.random.Generator, frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Every frame hurt inside its 32 bytes: bits flipped, bytes replaced, stretches shifted."""
    hurt = frames.copy()
    n, rows = len(frames), np.arange(len(frames))
    for _ in range(3):
        hits = rng.random(n) < 0.5
        hurt[hits, rng.integers(0, 32, n)[hits]] ^= (1 << rng.integers(0, 8, n)[hits]).astype(
            np.uint8
        )
    replaced = rng.random(n) < 0.3
    hurt[replaced, rng.integers(0, 32, n)[replaced]] = rng.integers(0, 256, n)[replaced]
    lost = rng.integers(0, 32, n)
    shifted = rng.random(n) < 0.3
    source = np.minimum(np.arange(32) + (np.arange(32) >= lost[:, None]), 31)
    hurt[shifted, :32] = hurt[rows[:, None], source][shifted]
    return hurt[(hurt != frames).any(axis=1)]


def test_no_false_accept_in_100_000_damaged_frames() -> None:
    rng = np.random.default_rng(20)
    clean = np.frombuffer(stream(np.arange(120_000)), np.uint8).reshape(-1, 33)
    hurt = damaged(rng, clean)
    assert len(hurt) > 100_000
    decoded = FrameDecoder(18).feed(hurt.tobytes(), 0.0)
    assert decoded.blocks == ()
    assert decoded.statuses == ()
    assert decoded.identities == ()
    assert decoded.rejected_frames >= 100_000


@given(st.binary(max_size=253))
def test_any_bytes_are_restored_and_have_no_zero_on_the_wire(data: bytes) -> None:
    stuffed = cobs_encode(data)
    assert 0 not in stuffed
    assert cobs_decode(stuffed) == data


@pytest.mark.parametrize(
    ("data", "wire"),
    [
        (b"", b"\x01"),
        (b"\x00", b"\x01\x01"),
        (b"\x11\x22\x00\x33", b"\x03\x11\x22\x02\x33"),
        (bytes(range(1, 254)), b"\xfe" + bytes(range(1, 254))),
    ],
)
def test_published_examples(data: bytes, wire: bytes) -> None:
    assert cobs_encode(data) == wire
    assert cobs_decode(wire) == data


@pytest.mark.parametrize("wire", [b"\x05\x11", b"\x02\x00", b"\x00"])
def test_invalid_cobs_is_refused(wire: bytes) -> None:
    with pytest.raises(ValueError, match="COBS"):
        cobs_decode(wire)
