"""The outcome of the self-test is decoded, and its sentences name wire and taxel."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.boards.taxel_frames import SelfTest, findings
from tests.boards import taxel_encoder

SMALL = st.integers(0, 255)
OUTCOMES = st.builds(
    SelfTest,
    **{f.name: SMALL for f in fields(SelfTest)[:-2]},
    silent=st.integers(0, 2**18 - 1),
    full=st.integers(0, 2**18 - 1),
)
GOOD = SelfTest(1, 15)


def found(**bits: int) -> list[str]:
    """Return the sentences for an outcome with these bits."""
    return findings(SelfTest(1, 15, **bits))


@given(OUTCOMES, st.integers(1, 40))
def test_an_outcome_between_samples_comes_back_whole(outcome: SelfTest, cut: int) -> None:
    counters = np.arange(4, dtype=np.int64)
    marks = np.zeros(4, np.uint8)
    data = taxel_encoder.encode_data(counters, np.full((4, 18), 511, np.uint16), marks, marks)
    wire = data + taxel_encoder.encode_self_test(outcome) + data[:0]
    decoder = FrameDecoder(18)
    pieces = [decoder.feed(wire[i : i + cut], 0.0) for i in range(0, len(wire), cut)]
    assert [t for p in pieces for t in p.self_tests] == [outcome]
    assert sum(len(b) for p in pieces for b in p.blocks) == 4
    assert sum(p.rejected_frames for p in pieces) == 0


def test_no_fault_gives_no_sentence() -> None:
    assert GOOD.passed
    assert findings(GOOD) == []


@pytest.mark.parametrize(
    ("bits", "sentences"),
    [
        ({"lines_low": 0b010}, ["line D5 stays low: it is connected to ground; free it"]),
        ({"lines_high": 0b100}, ["line D6 stays high: it is connected to 5 V; free it"]),
        (
            {"lines_together": 0b11},
            ["line D4 and line D5 are connected to each other: separate them"],
        ),
        (
            {"inputs_together": 0b10101},
            ["input A0, input A2 and input A4 are connected to each other: separate them"],
        ),
        ({"inputs_open": 0b1000}, ["input A3 has no divider to ground: solder its resistor"]),
        ({"silent": 1 << 7}, ["taxel 5 (line D5, input A1) does not conduct: it is open or torn"]),
        (
            {"silent": 0b111111 << 6 | 1},
            [
                "line D5 does not reach the sensor: its six taxels read nothing",
                "taxel 1 (line D4, input A0) does not conduct: it is open or torn",
            ],
        ),
        (
            {"silent": 1 << 2 | 1 << 8 | 1 << 14},
            ["input A2 does not reach the sensor: its three taxels read nothing"],
        ),
        (
            {"full": 1 << 8, "silent": 1 << 2 | 1 << 14 | 1 << 3},
            [
                "taxel 10 (line D4, input A3) does not conduct: it is open or torn",
                "taxel 6 (line D5, input A2) reads full scale with nothing on it: "
                "look for a short in the sensor",
            ],
        ),
    ],
)
def test_a_sentence_names_the_wire_or_the_taxel(bits: dict[str, int], sentences: list[str]) -> None:
    assert found(**bits) == sentences


def test_faults_explained_by_a_broken_wire_are_not_repeated() -> None:
    assert len(found(lines_low=1, silent=0b111111)) == 1
    assert len(found(inputs_high=1, full=1 << 0 | 1 << 6 | 1 << 12)) == 1


def test_an_unplugged_sensor_is_one_sentence() -> None:
    (sentence,) = found(silent=2**18 - 1)
    assert "plug the sensor in" in sentence


def test_taxels_are_named_by_their_place() -> None:
    wiring = [*range(17, -1, -1)]
    (sentence,) = findings(SelfTest(1, 15, full=1 << 17), wiring)
    assert sentence.startswith("taxel 1 (line D6, input A5) reads full scale")
