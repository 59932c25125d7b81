"""Trials cut from the taxel samples at the sync line's rise, exact to the sample."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.boards.taxel_frames import Flag
from rigctl.engine.trial_cutter import CutTrial, TrialCutter
from rigctl.values import Block

N = 400
RISE_IN = 100
LENGTH = 200


def stream(
    rises_in: tuple[int, ...] = (RISE_IN,), lost: Iterable[int] = (), n: int = N, high: int = 250
) -> Block:
    """Return samples 0…n-1 with sync rising during the given frames, without the ``lost`` ones."""
    counters = np.arange(n)
    rises = np.zeros(n, np.int64)
    flags = np.zeros(n, np.uint8)
    for frame in rises_in:
        rises[frame:] += 1
        flags[frame : frame + high] = Flag.SYNC
    kept = ~np.isin(counters, list(lost))
    edges = (rises % 4).astype(np.uint8)
    samples = np.zeros((n, 18), np.uint16)
    return Block(counters[kept], samples[kept], flags[kept], edges[kept], (), 0.0)


def split(block: Block, positions: list[int]) -> list[Block]:
    bounds = [0, *sorted(positions), len(block)]
    return [
        Block(
            block.counters[a:b],
            block.samples[a:b],
            block.flags[a:b],
            block.edges[a:b],
            (),
            0.0,
        )
        for a, b in pairwise(bounds)
        if b > a
    ]


def cut(blocks: list[Block]) -> CutTrial | None:
    cutter = TrialCutter()
    cutter.expect(LENGTH)
    for block in blocks:
        cutter.add_block(block)
    return cutter.trial


def test_the_first_sample_is_the_frame_that_starts_after_the_rise() -> None:
    trial = cut([stream()])
    assert trial == CutTrial(RISE_IN + 1, LENGTH, received=LENGTH, newest_counter=N - 1)
    assert trial.complete


@given(st.lists(st.integers(0, N), max_size=12))
def test_any_block_size_cuts_the_same_trial(positions: list[int]) -> None:
    trial = cut(split(stream(), positions))
    whole = cut([stream()])
    assert trial is not None and whole is not None
    assert (trial.first_counter, trial.received) == (whole.first_counter, whole.received)
    assert (trial.start_lost, trial.sync_low) == (False, 0)


def test_a_lost_frame_within_the_trial_is_counted_and_moves_nothing() -> None:
    trial = cut([stream(lost=range(150, 153))])
    assert trial is not None
    assert (trial.first_counter, trial.received, trial.start_lost) == (101, LENGTH - 3, False)
    assert trial.longest_gap == 3


@given(st.lists(st.integers(0, N), max_size=12))
def test_any_block_size_has_the_same_longest_gap(positions: list[int]) -> None:
    trial = cut(split(stream(lost=[130, 150, 151, 170]), positions))
    assert trial is not None and (trial.longest_gap, trial.start_lost) == (2, False)


@pytest.mark.parametrize(("lost", "gap"), [(range(95, 98), 0), ([101], 1)])
def test_a_trial_lacks_its_first_sample_only_where_that_is_lost(
    lost: Iterable[int], gap: int
) -> None:
    trial = cut([stream(lost=lost)])
    assert trial is not None
    assert (trial.longest_gap, trial.start_lost) == (gap, bool(gap))


def test_lost_last_samples_are_a_gap() -> None:
    trial = cut([stream(lost=range(RISE_IN + LENGTH - 1, RISE_IN + LENGTH + 20))])
    assert trial is not None and trial.longest_gap == 2


def test_a_rise_in_a_lost_frame_is_known_but_its_place_is_not() -> None:
    trial = cut([stream(lost=range(95, 105))])
    assert trial is not None
    assert trial.start_lost


def test_a_gap_between_blocks_before_the_rise_is_detected() -> None:
    block = stream(lost=range(95, 101))
    trial = cut(split(block, [95]))
    assert trial is not None
    assert trial.start_lost


def test_rises_within_a_gap_are_known_at_its_end() -> None:
    block = stream(rises_in=(50, 60, 70), lost=range(45, 80))
    assert TrialCutter().add_block(block) == [81]


def test_only_an_expected_rise_begins_a_trial() -> None:
    cutter = TrialCutter()
    early, late = split(stream(rises_in=(50, 200)), [120])
    cutter.add_block(early)
    cutter.expect(LENGTH)
    cutter.add_block(late)
    assert cutter.trial is not None
    assert cutter.trial.first_counter == 201


def test_sync_falling_within_the_trial_is_counted() -> None:
    trial = cut([stream(high=150)])
    assert trial is not None
    assert trial.sync_low == LENGTH - 149


@pytest.mark.parametrize("first", [0, 3])
def test_the_first_block_of_a_stream_is_no_rise(first: int) -> None:
    block = stream(rises_in=())
    joined = Block(
        block.counters, block.samples, block.flags, block.edges + np.uint8(first), (), 0.0
    )
    assert cut([joined]) is None


def begun(blocks: list[Block], known_after: int) -> CutTrial | None:
    """Cut without the wire, given the first sample after a number of blocks."""
    cutter = TrialCutter()
    cutter.expect(LENGTH, by_wire=False)
    for block in blocks[:known_after]:
        cutter.add_block(block)
    cutter.begin(RISE_IN + 1)
    for block in blocks[known_after:]:
        cutter.add_block(block)
    return cutter.trial


@given(st.lists(st.integers(0, N), max_size=8), st.integers(0, 8))
def test_a_trial_begun_late_is_cut_from_its_first_sample(positions: list[int], at: int) -> None:
    blocks = split(stream(rises_in=()), positions)
    trial = begun(blocks, min(at, len(blocks)))
    assert trial is not None
    assert (trial.received, trial.sync_low, trial.complete) == (LENGTH, 0, True)
    assert not trial.by_wire


def test_without_the_wire_lost_samples_count_and_noise_on_the_line_begins_no_trial() -> None:
    blocks = split(stream(rises_in=(50, 70), lost=range(150, 160)), [120])
    trial = begun(blocks, 1)
    assert trial is not None
    assert (trial.first_counter, trial.received) == (RISE_IN + 1, LENGTH - 10)
