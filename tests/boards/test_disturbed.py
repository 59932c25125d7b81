"""Traffic with drops, repeats, swaps and flipped bits: nothing wrong, and every loss counted.

``tests/soak/soak_decoders.py`` is the long form.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.boards.taxel_decoder import Decoded, FrameDecoder
from rigctl.finger.decoder import FingerBlock, FingerDecoder
from tests.boards.disturbance import DISTURBANCES, Disturbance, cut
from tests.boards.disturbed_boards import (
    QUIET,
    finger_frames,
    run_finger,
    run_taxels,
    taxel_frames,
)
from tests.boards.disturbed_drum import run_drum
from tests.boards.disturbed_trackers import run_tracker

N_BYTES, SMALL = 300_000, 60_000
BOOT_SAMPLES = 3_000
EACH = pytest.mark.parametrize("how", DISTURBANCES, ids=lambda how: how.name)
shares = st.floats(0, 0.3)
mixtures = st.builds(Disturbance, st.just("any"), shares, shares, shares, shares)


@EACH
def test_of_the_taxel_board(how: Disturbance) -> None:
    judgement = run_taxels(how, N_BYTES, 7, BOOT_SAMPLES)
    assert judgement.holds, judgement
    assert judgement.samples > 0.95 * judgement.intact
    assert judgement.reboots > 0


@EACH
def test_of_the_finger_board(how: Disturbance) -> None:
    judgement = run_finger(how, N_BYTES, 7, BOOT_SAMPLES)
    assert judgement.holds, judgement
    assert judgement.samples > 0.85 * judgement.intact
    assert judgement.reboots > 0


@EACH
def test_of_the_drum(how: Disturbance) -> None:
    judgement = run_drum(how, SMALL, 7)
    assert judgement.holds, judgement


@EACH
@pytest.mark.parametrize("kind", ["lines", "datagrams", "IMU"])
def test_of_trackers(kind: str, how: Disturbance) -> None:
    judgement = run_tracker(kind, how, SMALL, 7)
    assert judgement.holds, judgement


@given(mixtures, st.integers(0, 2**32), st.lists(st.integers(0, 20_000), max_size=40))
@settings(max_examples=40, deadline=None)
def test_any_slicing_of_any_mixture_gives_the_same(
    how: Disturbance, seed: int, cuts: list[int]
) -> None:
    frames = [*taxel_frames(0, range(5_000_000, 5_000_300)), *taxel_frames(1, range(250))]
    wire = b"".join(how.apply(frames, np.random.default_rng(seed)))
    edges = [0, *sorted(at % (len(wire) + 1) for at in cuts), len(wire)]
    pieces = [wire[a:b] for a, b in pairwise(edges)]
    assert _taxel_values(pieces) == _taxel_values([wire])


def _taxel_values(pieces: list[bytes]) -> list[object]:
    decoder = FrameDecoder(18)
    decoder.resync()
    decoded: list[Decoded] = [decoder.feed(piece, 0.0) for piece in pieces]
    blocks = [block for part in decoded for block in part.blocks]
    return [
        np.concatenate([np.zeros(0, np.int64), *(block.counters for block in blocks)]).tolist(),
        [gap for block in blocks for gap in block.gaps],
        [status for part in decoded for status in part.statuses],
        [sum(part[at] for part in decoded) for at in range(4, 8)],
    ]


@given(mixtures, st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_counters_of_the_finger_ascend_and_every_loss_is_counted(
    how: Disturbance, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    frames = list(finger_frames(0, range(65_536 * 3 - 700, 65_536 * 3 + 700)))
    wire = b"".join(frames[:QUIET] + how.apply(frames[QUIET:], rng))
    decoder = FingerDecoder()
    decoder.resync()
    blocks: list[FingerBlock] = [decoder.feed(piece)[0] for piece in cut(wire, rng)]
    counters = np.concatenate([block.counters for block in blocks])
    missing = sum(block.missing for block in blocks)
    assert (np.diff(counters) > 0).all()
    assert len(counters) + missing == counters[-1] - counters[0] + 1
