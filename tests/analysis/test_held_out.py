"""The held-out classification of a session, down to the figures on disk."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from rigctl.analysis.held_out import (
    HeldOutPredictions,
    classify_held_out,
    with_repeats,
)
from rigctl.analysis.report.demo import accuracy_sentence, analyse_sessions
from rigctl.analysis.trial_set import Design, join_sessions
from rigctl.errors import SessionError, WrongUse
from tests.analysis.recordings import record


def test_the_counts_equal_those_worked_out_by_hand() -> None:
    labels = np.array([0, 0, 0, 1, 1])
    held_out = HeldOutPredictions(
        ("A", "B"), labels, np.array([[0, 0, 1, 1, 0], [0, 0, 0, 1, 1]]), 2, 1
    )
    assert held_out.correct_counts().tolist() == [3, 5]
    assert held_out.chance == 0.6
    assert held_out.confusion().tolist() == [[2, 1], [1, 1]]
    assert "60.0% (3 of n = 5 trials" in accuracy_sentence(held_out)
    assert "chance 60.0%" in accuracy_sentence(held_out)


def design(textures: str, speed_mm_s: float) -> Design:
    names, labels = np.unique(list(textures), return_inverse=True)
    n = len(labels)
    return Design(tuple(names.tolist()), labels, np.full(n, speed_mm_s), np.full(n, 500.0))


def test_shuffled_labels_give_chance_accuracy() -> None:
    """Nothing leaks from the test part: shuffled labels give no more than luck."""
    shares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        samples = [rng.integers(300, 700, (200, 3)).astype(np.uint16) for _ in range(80)]
        textures = "".join(rng.permutation(np.repeat(list("ABDL"), 20)))
        held_out = classify_held_out(samples, design(textures, 120.0), seed=seed)
        shares.append(held_out.correct_counts().mean() / held_out.n)
    assert held_out.chance == 0.25
    assert abs(np.mean(shares) - 0.25) < 0.04


def test_unsuitable_sessions_are_refused_with_a_reason() -> None:
    samples = [np.zeros((100, 2), np.uint16)] * 3
    with pytest.raises(WrongUse, match="two textures"):
        classify_held_out(samples, design("AAA", 40.0))
    with pytest.raises(WrongUse, match="texture B has a single"):
        classify_held_out(samples, design("ABA", 40.0))


def test_a_session_gives_a_result_and_two_figures(tmp_path: Path) -> None:
    stages: list[str] = []
    session = record(tmp_path / "session", travel_mm=60.0, torn=(5,))
    answer = analyse_sessions(
        [session], tmp_path / "figures", progress=lambda s, *_: stages.append(s)
    )
    assert answer.held_out.n == 23
    assert answer.remarks == (f"{session}: 1 trial left out for gaps in their samples: 5",)
    right = answer.held_out.correct_counts()[answer.held_out.shown_components - 1]
    assert right / 23 > 2 * answer.held_out.chance
    assert stages.count("classifying") == 5
    for png in (answer.raster, answer.accuracy):
        assert png.read_bytes().startswith(b"\x89PNG")
        root = ElementTree.parse(png.with_suffix(".svg")).getroot()
        text = " ".join(root.itertext())
        assert "Simulated bench (virtual" in text
        for word in ("(s)", "(mm)", "(g)", "SAII", "taxel") if png == answer.raster else ("%)",):
            assert word in text


def test_equal_sessions_give_equal_drawings(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "AB", travel_mm=24.0)
    first = analyse_sessions([session], tmp_path / "one")
    second = analyse_sessions([session], tmp_path / "two")
    for a, b in ((first.raster, second.raster), (first.accuracy, second.accuracy)):
        assert a.with_suffix(".svg").read_bytes() == b.with_suffix(".svg").read_bytes()
        assert a.read_bytes() == b.read_bytes()
    other = record(tmp_path / "other", "AB", travel_mm=24.0)
    both = analyse_sessions([session, other], tmp_path / "both")
    assert both.held_out.n == 2 * first.held_out.n
    assert both.origin == "Simulated bench · sessions session, other"


def test_a_session_without_a_complete_trial_is_refused(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "A", travel_mm=12.0, torn=tuple(range(1, 7)))
    with pytest.raises(SessionError, match="no complete trial"):
        analyse_sessions([session], tmp_path)


def test_a_texture_with_a_single_trial_is_left_out_alone(tmp_path: Path) -> None:
    session = record(
        tmp_path / "session", "ABD", repeats=2, travel_mm=12.0, speeds=(40,), forces=(250,)
    )
    trials = join_sessions([session])
    row = next(row for row, trial in enumerate(trials.trials) if trial.texture == "B")
    found = with_repeats(trials.without([row], "torn"))
    assert found.textures == ("A", "D") and len(found.trials) == 4
    assert found.remarks[-1] == "textures left out for a single trial: B"
    assert with_repeats(trials) is trials
