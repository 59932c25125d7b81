"""The outcome of the search for C: both shares, and every entry that did not converge."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.force_scaling import (
    ForceMatrixSource,
    describe_transfer,
    force_sentence,
    unconverged_entries,
    unconverged_shares,
)
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.root_bracket import SearchStatus

SHAPE = (2, 3, 1, 3)
"""Textures, taxels, speeds and forces."""


@pytest.fixture
def force() -> ForceMatrix:
    """Two entries that did not converge among twelve searched, and one above 5 that did."""
    c, status = np.ones(SHAPE), np.full(SHAPE, SearchStatus.CONVERGED, np.int8)
    status[..., 1] = SearchStatus.REFERENCE
    residual, rate = np.zeros(SHAPE), np.full(SHAPE, 20.0)
    c[0, 0, 0, 0] = 7.5
    for at, outcome, value, miss, reached in (
        ((1, 2, 0, 0), SearchStatus.CAPPED, 5.0, -1.5, 0.0),
        ((0, 1, 0, 2), SearchStatus.DISCONTINUITY, 0.8, 0.25, 2.0),
    ):
        status[at], c[at], residual[at], rate[at] = outcome, value, miss, reached
    levels = (("A", "B"), (40.0,), (250.0, 500.0, 1000.0), 500.0)
    return ForceMatrix(*levels, c, status, residual, np.ones(SHAPE), rate)


def test_every_entry_that_did_not_converge_has_rate_target_and_difference(
    force: ForceMatrix,
) -> None:
    worst, other = unconverged_entries(force)
    assert worst.as_dict() == {
        "texture": "B", "taxel": 3, "speed_mm_s": 40.0, "force_g": 250.0, "status": "capped",
        "c": 5.0, "rate_hz": 0.0, "target_hz": 1.5, "difference_hz": -1.5,
    }  # fmt: skip
    assert (other.texture, other.taxel, other.force_g) == ("A", 2, 1000.0)
    assert (other.status, other.target_hz) == ("discontinuity", 1.75)


def test_both_shares_stand_beside_the_papers(force: ForceMatrix) -> None:
    shares = unconverged_shares(force)
    assert (shares["unconverged"], shares["searched"], shares["entries"]) == (2, 12, 18)
    assert shares["above_limit"] == 1
    assert shares["paper"] == {
        "unconverged": 62, "of": 4320, "searched": 2880, "unconverged_rate_hz": 2.0,
    }  # fmt: skip
    sentence = force_sentence(force)
    for words in (
        "10 converged within 0.1 Hz (1 of them above 5), 1 did not and are limited to 5",
        "16.7 %, 2 of 12 searched (the paper: 2.2 %, 62 of 2,880)",
        "11.1 %, 2 of 18 with the reference entries (the paper: 1.4 %, 62 of 4,320)",
        "at most 1.5 of 1.5 Hz (texture B, taxel 3, 40 mm/s, 250 g), and the highest target is "
        "1.8 Hz (the paper: trains of at most 2 spikes/s)",
    ):
        assert words in sentence


def test_a_c_of_an_older_file_has_differences_alone(force: ForceMatrix) -> None:
    old = replace(force, rate_hz=None)
    worst = unconverged_entries(old)[0].as_dict()
    assert (worst["rate_hz"], worst["target_hz"], worst["difference_hz"]) == (None, None, -1.5)
    assert "at most 1.5 Hz (texture B" in force_sentence(old)
    json.dumps(worst, allow_nan=False)


def test_a_search_that_always_converged_lists_nothing(force: ForceMatrix) -> None:
    status = np.minimum(force.status, SearchStatus.CONVERGED)
    whole = replace(force, status=status)
    assert unconverged_entries(whole) == []
    assert "miss their targets" not in force_sentence(whole)


def test_a_transferred_c_says_how_many_searches_did_not_converge(force: ForceMatrix) -> None:
    source = ForceMatrixSource(Path("c.h5"), force, ())
    sentence = describe_transfer(source, []).sentence
    assert sentence.endswith("was not searched; 2 of 12 searches did not converge where it was")
    whole = replace(force, status=np.minimum(force.status, SearchStatus.CONVERGED))
    assert describe_transfer(source._replace(force=whole), []).sentence.endswith("not searched")
