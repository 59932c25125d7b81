"""Promises on scores that are exchangeable by construction: coverage, false alarms, error rates."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.finger.analysis.classifier import (
    confidence_of,
    conformal_limit,
    decision_threshold,
    sequential_answers,
)
from rigctl.finger.model_file import FingerCalibration

Floats = NDArray[np.float64]
CLASSES, WINDOWS = 5, 6


def _trials(n: int, seed: int, sharpness: float = 1.2) -> FingerCalibration:
    """Return trials whose evidence grows with the windows; the log posteriors are too sure."""
    random = np.random.default_rng(seed)
    labels = random.integers(0, CLASSES, n)
    evidence = random.normal(0, 1, (WINDOWS, n, CLASSES))
    evidence[:, np.arange(n), labels] += sharpness
    logs = 3.0 * np.cumsum(evidence, axis=0)
    distances = random.chisquare(9, (WINDOWS, n))
    return FingerCalibration(np.zeros(180), labels, logs, distances)


def test_sets_hold_the_truth_as_often_as_promised_and_not_much_more() -> None:
    held = []
    for seed in range(40):
        confidence = confidence_of(_trials(50, seed), coverage=0.9)
        new = _trials(200, 1000 + seed)
        for n_windows in (1, WINDOWS):
            sets = confidence.texture_sets(
                n_windows, confidence.probabilities(n_windows, new.logs[n_windows - 1])
            )
            held.append(sets[np.arange(200), new.labels].mean())
    assert 0.89 < np.mean(held) < 0.94


def test_a_limit_is_the_right_order_statistic() -> None:
    scores = np.arange(1.0, 51.0)
    assert conformal_limit(scores, 0.95) == 49.0, "rank ⌈51 · 0.95⌉"
    assert conformal_limit(scores[:19], 0.95) == 19.0
    assert conformal_limit(scores[:18], 0.95) == np.inf, "too few trials promise nothing"


def test_probabilities_are_calibrated() -> None:
    """Where 70 to 80 % are claimed, about as many are right; the raw posteriors claim far more."""
    confidence, new = confidence_of(_trials(400, 1)), _trials(4000, 2)
    assert np.all(confidence.temperatures > 1.5)
    best = confidence.probabilities(2, new.logs[1]).max(axis=1)
    right = new.logs[1].argmax(axis=1) == new.labels
    claimed = (best > 0.7) & (best < 0.8)
    assert 0.68 < right[claimed].mean() < 0.82


def test_known_textures_are_called_unknown_as_rarely_as_asked() -> None:
    shares = [
        1.0
        - confidence_of(_trials(50, seed)).is_known(3, _trials(200, 500 + seed).distances[2]).mean()
        for seed in range(30)
    ]
    assert 0.02 < np.mean(shares) < 0.06
    assert not confidence_of(_trials(50, 1)).is_known(3, np.array([1000.0]))[0]


@pytest.mark.parametrize("asked", [0.05, 0.2])
def test_early_answers_are_wrong_as_rarely_as_asked(asked: float) -> None:
    wrong, answered_shares, windows = 0, [], []
    total = 0
    for seed in range(40):
        confidence = confidence_of(_trials(60, seed), error_rate=asked)
        new = _trials(200, 2000 + seed)
        rows = [confidence.probabilities(k + 1, logs) for k, logs in enumerate(new.logs)]
        answered, answers, at = sequential_answers(np.stack(rows), confidence.threshold)
        wrong += int((answers != new.labels)[answered].sum())
        total += int(answered.sum())
        answered_shares.append(answered.mean())
        windows += at[answered].tolist()
    assert wrong / total < 1.1 * asked
    assert np.mean(answered_shares) > 0.6 and np.mean(windows) < WINDOWS - 1


def test_an_error_rate_beyond_the_calibration_is_never_promised() -> None:
    few = confidence_of(_trials(19, 1, sharpness=9.0), error_rate=0.05)
    assert not few.can_answer and few.threshold > 1.0
    assert confidence_of(_trials(20, 1, sharpness=9.0), error_rate=0.05).can_answer
    guesses = confidence_of(_trials(200, 1, sharpness=0.0), error_rate=0.05)
    assert not guesses.can_answer


def test_the_first_class_that_is_sure_enough_is_the_answer() -> None:
    probabilities = np.array([[[0.6, 0.4], [0.5, 0.5]], [[0.2, 0.8], [0.3, 0.7]]])
    answered, answers, windows = sequential_answers(probabilities, 0.6)
    assert answered.tolist() == [True, True]
    assert answers.tolist() == [0, 1] and windows.tolist() == [1, 2]
    answered, answers, windows = sequential_answers(probabilities, 0.75)
    assert answered.tolist() == [True, False] and answers.tolist() == [1, 1]
    labels = np.array([0, 1])
    assert decision_threshold(probabilities, labels, 0.05) > 1.0


@pytest.mark.parametrize("name", ["coverage", "false_alarm", "error_rate"])
def test_impossible_shares_are_refused(name: str) -> None:
    for share in (0.0, 1.0):
        with pytest.raises(WrongUse, match="between 0 and 1"):
            confidence_of(_trials(20, 0), **{name: share})
