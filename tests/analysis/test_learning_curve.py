"""The learning curve of a session: which trials it takes, its interval, and how it grows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.learning_curve import (
    Condition,
    GrowingCurve,
    describe_shortfall,
    largest_block,
    learning_curve,
)
from rigctl.analysis.trial_set import join_sessions
from rigctl.encoder.features import FeatureLayout, feature_matrices
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session, add_note
from rigctl.values import PlannedTrial
from tests.analysis.learning_coverage import measure
from tests.analysis.recordings import record
from tests.session import building

SLOW, FAST = (40.0, 250.0, 0.0), (120.0, 250.0, 0.0)


def test_a_point_takes_plates_that_have_the_same_conditions() -> None:
    trials: dict[str, dict[Condition, list[int]]] = {
        "A": {SLOW: [0, 1, 2], FAST: [3, 4, 5]},
        "B": {SLOW: [6, 7, 8], FAST: [9, 10]},
        "C": {SLOW: [11, 12]},
    }
    assert largest_block(trials, 2) == (("A", "B"), (SLOW, FAST))
    assert largest_block(trials, 3) == (("A", "B"), (SLOW,))
    assert largest_block(trials, 4) == ((), ())
    assert largest_block({"A": trials["A"]}, 1) == ((), ())


def test_plates_that_differ_are_told_apart_sooner_than_alike_ones() -> None:
    random = np.random.default_rng(0)
    trials, features, row = {}, {}, 0
    for plate, level in (("A", 0.0), ("B", 3.0), ("C", 0.0)):
        rows = list(range(row, row + 12))
        features |= {r: level + random.normal(size=20) for r in rows}
        trials[plate] = {SLOW: rows}
        row += 12
    points = learning_curve(trials, features, {})
    assert [point.n_trials for point in points] == [3, 4, 6, 8, 12]
    last = points[-1]
    assert (last.plates, last.tested, last.chance) == (("A", "B", "C"), 36, 1 / 3)
    assert 0.55 < last.accuracy < 0.85 and last.low < last.accuracy < last.high
    assert last.high - last.low < points[0].high - points[0].low


def test_the_interval_holds_the_accuracy_as_often_as_it_says() -> None:
    """An interval at a fixed number of trials; 95 % is what Wilson's promises for free trials."""
    random = np.random.default_rng(1)
    levels = random.normal(0, 0.6, (4, 12))
    features = {r: levels[r // 200] + random.normal(size=12) for r in range(800)}
    trials = {name: {SLOW: list(range(200 * i, 200 * i + 200))} for i, name in enumerate("ABDL")}
    for n_trials in (4, 16):
        found = measure(trials, features, n_trials, draws=200)
        assert 0.5 < found.accuracy < 0.95
        assert found.share > 0.88, found


def test_too_few_trials_are_said_in_words() -> None:
    assert "no complete trial" in describe_shortfall({})
    one = describe_shortfall({"A": {SLOW: [0, 1]}})
    assert one == ("Not enough trials yet: two plates are needed to tell them apart; A has 2.")
    two = describe_shortfall({"A": {SLOW: [0, 1]}, "B": {FAST: [2]}})
    assert two.endswith("A has 2, B has 1.") and "same speeds and forces" in two


def test_a_session_has_a_curve_that_says_where_its_range_is_from(tmp_path: Path) -> None:
    session = record(tmp_path / "s", "ABD", repeats=4, torn=(2,))
    growing = GrowingCurve(session)
    curve = growing.curve()
    growing.session.close()
    assert curve.simulated and (curve.trials, curve.committed) == (71, 72)
    assert [point.n_trials for point in curve.points] == [1, 2, 3, 4]
    assert [point.n_conditions for point in curve.points] == [6, 6, 6, 5]
    assert curve.points[2].accuracy > 0.8
    assert "No calibrated range" in curve.remarks[0]
    assert curve.remarks[-1].startswith("1 trial is left out")


def test_the_features_are_those_of_the_analysis(tmp_path: Path) -> None:
    session = record(tmp_path / "s", "AB", repeats=2)
    growing = GrowingCurve(session)
    growing.update()
    found = join_sessions([session])
    with Session.open(session) as opened:
        samples = [opened.samples(trial.row) for trial in found.trials]
    ranges = Normalisation.from_samples(samples[:16], "the first 16 trials")
    speeds = [trial.speed_mm_s for trial in found.trials]
    layout = FeatureLayout.covering(list(map(len, samples)), speeds, scaled=True)
    (expected,) = feature_matrices(samples, speeds, ranges, [layout])
    rows = [trial.row for trial in found.trials]
    assert np.array_equal(np.array([growing.features[row] for row in rows]), expected)
    growing.session.close()


def commit(recorder: Recorder, trial: PlannedTrial, first: int) -> int:
    end = first + building.BLOCK * (-(-trial.n_samples // building.BLOCK) + 2)
    for counter in range(first, end, building.BLOCK):
        recorder.add_block(building.block(counter))
    recorder.commit_trial(building.trial_row(trial, first))
    recorder.wait_written()
    return end


def test_new_trials_of_a_growing_session_are_encoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    low, high = tuple([0] * 18), tuple([1023] * 18)
    calibrated = replace(building.header(), taxel_low=low, taxel_high=high)
    plan = building.plan()
    with Recorder(tmp_path / "s", calibrated, building.PROTOCOL, building.RIG) as recorder:
        recorder.begin_part("start", "A")
        first = commit(recorder, plan.trials[0], 0)
        growing = GrowingCurve(tmp_path / "s")
        growing.update()
        before = dict(growing.features)
        assert list(before) == [0] and growing.has_calibrated_range
        for trial in plan.trials[1:3]:
            first = commit(recorder, trial, first)
        growing.update()
        assert list(growing.features) == [0, 1, 2]
        assert growing.features[0] is before[0]
        growing.session.close()


def test_a_trial_marked_bad_leaves_the_curve(tmp_path: Path) -> None:
    session = record(tmp_path / "s", "AB", repeats=2)
    growing = GrowingCurve(session)
    whole = growing.curve().points[-1]
    add_note(session, SessionNote("2026-11-21T13:00:00Z", "slipped", 1, 0, Mark.BAD, ""))
    fewer = growing.curve()
    assert (whole.n_trials, whole.tested) == (2, 24)
    assert fewer.trials == 23 and fewer.points[-1].tested < 24
    growing.session.close()
