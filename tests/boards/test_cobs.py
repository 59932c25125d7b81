"""COBS carries any bytes without a zero and refuses what no encoder wrote."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.boards.taxel_frames import cobs_encode
from tests.boards.taxel_encoder import cobs_decode


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
