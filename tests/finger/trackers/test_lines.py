"""Lines of trackers: the same values in any slicing, and garbage costs only its line."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.finger.trackers.lines import ImuLines, PositionLines, TrackerReading, decode_datagram

numbers = st.floats(-9999, 9999).map(lambda value: round(value, 3))
good = st.tuples(numbers, numbers, numbers, numbers)
garbage = st.binary(max_size=300).map(lambda data: b"x" + data.replace(b"\n", b""))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.one_of(good, garbage), max_size=20), st.lists(st.integers(1, 40), max_size=200))
def test_any_slicing_gives_the_good_lines_and_counts_the_others(
    lines: list[tuple[float, ...] | bytes], slices: list[int]
) -> None:
    texts = [
        line if isinstance(line, bytes) else ",".join(map(str, line)).encode() for line in lines
    ]
    data = b"".join(text + b"\r\n" for text in texts)
    decoder, decoded = PositionLines(), []
    for size in [*slices, len(data)]:
        decoded += decoder.feed(data[:size])
        data = data[size:]
    assert decoded == [TrackerReading(*line, True) for line in lines if isinstance(line, tuple)]
    assert decoder.malformed == sum(isinstance(line, bytes) for line in lines)


@pytest.mark.parametrize(
    "line",
    [
        *("", "1,2,3", "1,2,3,4,5", "1,2,3,4,0,0", "1,2,3,nan", "1,inf,3,4", "1,2,3,1_0"),
        *("1,2,,4", "1,2,3,0x10", "1,2,3,1e99", "1,2,3,٣", "1,2,3," + "0" * 300),
    ],
)
def test_what_is_no_position_is_counted(line: str) -> None:
    decoder = PositionLines()
    assert decoder.feed(line.encode() + b"\n1,2,3,4\n") == [TrackerReading(1, 2, 3, 4, True)]
    assert decoder.malformed == 1


def test_a_tracker_may_say_that_it_is_lost() -> None:
    decoder = PositionLines()
    assert [r.valid for r in decoder.feed(b"1,2,3,4,0\n2, 2 ,3,4e-1 ,1\n")] == [False, True]


def test_a_stream_that_is_joined_in_a_line_drops_its_rest_uncounted() -> None:
    decoder = PositionLines(joins=True)
    assert decoder.feed(b"45,6,7,8\n1,2,3,") == []
    assert decoder.feed(b"4\n") == [TrackerReading(1, 2, 3, 4, True)]
    assert decoder.malformed == 0


def test_an_endless_line_takes_no_memory() -> None:
    decoder = PositionLines()
    for _ in range(1000):
        decoder.feed(b"7" * 1000)
    assert len(decoder._lines._tail) < 1300
    assert decoder.feed(b"\n1,2,3,4\n") == [TrackerReading(1, 2, 3, 4, True)]
    assert decoder.malformed == 1


def test_a_checksum_is_checked_and_missed_once_one_was_right() -> None:
    decoder = PositionLines()
    assert decoder.feed(b"1,2,3,4\n120.5,10,20,30*04\r\n") == [
        TrackerReading(1, 2, 3, 4, True),
        TrackerReading(120.5, 10, 20, 30, True),
    ]
    assert decoder.feed(b"120.5,11,20,30*04\n120.5,10,20,30.04\n120.5,10,20,30*4\n") == []
    assert decoder.malformed == 3
    assert decode_datagram(b"7,1,2,3,4*33") == (7, TrackerReading(1, 2, 3, 4, True))


def test_lines_of_an_imu() -> None:
    decoder = ImuLines()
    (reading,) = decoder.feed(b"9.8,0\n5,0.1,-0.2,9.81,0.01,0,-.02\n1,2\n")
    assert reading == (5.0, (0.1, -0.2, 9.81), (0.01, 0.0, -0.02))
    assert decoder.malformed == 1


def test_a_datagram_is_one_numbered_position() -> None:
    assert decode_datagram(b"7,1.5,2,3,4") == (7, TrackerReading(1.5, 2, 3, 4, True))
    assert decode_datagram(b"7,1.5,2,3,4,0\r\n") == (7, TrackerReading(1.5, 2, 3, 4, False))
    for data in (
        b"",
        b"\n",
        b"1,2,3,4",
        b"-1,2,3,4,5",
        b"1.5,2,3,4,5",
        b"1,2,3,4,5\n" * 2,
        b"\xff",
    ):
        assert decode_datagram(data) is None
