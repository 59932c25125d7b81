"""Answers that grow with the scan are those of the recorded scan, and say how sure they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis.finger.classifier import FingerClassifier
from rigctl.analysis.finger.scans import KINDS, ScanKind
from rigctl.errors import WrongUse
from tests.analysis.finger.made_scans import made_data_set
from tests.analysis.finger.models import calibrated_model

DATA_SET = made_data_set(1, repeats=4)
CLASSIFIER = FingerClassifier(calibrated_model(DATA_SET))
TESTED = DATA_SET.tested


@pytest.mark.parametrize("kind", KINDS)
def test_live_answers_equal_those_of_recorded_scans(kind: ScanKind) -> None:
    classifier = FingerClassifier(calibrated_model(DATA_SET, kind))
    predictions = classifier.predict_scans(TESTED)
    for row in (0, 37):
        for n_windows in (1, 9):
            rates = TESTED.evidence(kind, n_windows)[row, :n_windows]
            answer = classifier.answer(rates)
            found = predictions.probabilities[n_windows - 1, row]
            assert answer.probabilities.tobytes() == found.tobytes()
            assert answer.n_windows == n_windows
            held = predictions.sets[n_windows - 1, row]
            assert [name in answer.texture_set for name in classifier.model.textures] == list(held)
            assert answer.novelty_p == predictions.novelty_p[n_windows - 1, row]
            assert answer.texture == classifier.model.textures[int(found.argmax())]


def test_at_the_end_missing_windows_count_as_zero() -> None:
    kind = ScanKind.ORIGINAL
    classifier = FingerClassifier(calibrated_model(DATA_SET, kind))
    row = int(TESTED.n_time_windows.argmin())
    n = int(TESTED.n_time_windows[row])
    assert n < 20
    whole = classifier.answer(TESTED.time_rates[row, :n], whole=True)
    last = classifier.predict_scans(TESTED).probabilities[-1, row]
    assert whole.probabilities.tobytes() == last.tobytes() and whole.n_windows == 20


def test_answers_after_any_window_follow_the_stages() -> None:
    predictions = CLASSIFIER.predict_scans(TESTED).probabilities.argmax(axis=2)
    running = np.zeros(len(TESTED), bool)
    for n_windows in (1, 12, 20):
        found = CLASSIFIER.predict_after(TESTED, np.full(len(TESTED), n_windows), running)
        assert np.array_equal(found, predictions[n_windows - 1])
    none = np.zeros(len(TESTED), np.int64)
    assert np.all(CLASSIFIER.predict_after(TESTED, none, running) == -1)
    assert np.array_equal(CLASSIFIER.predict_after(TESTED, none, ~running), predictions[-1])


def test_an_unheard_pattern_is_none_of_the_textures() -> None:
    known = [CLASSIFIER.answer(rates).known for rates in TESTED.windows]
    assert np.mean(known) > 0.85
    random = np.random.default_rng(0)
    strange = CLASSIFIER.answer(random.uniform(0, 600, (20, 9)))
    assert not strange.known and strange.novelty_p < 0.05


def test_without_a_calibration_nothing_is_promised() -> None:
    plain = FingerClassifier(replace(CLASSIFIER.model, calibration=None))
    answer = plain.answer(TESTED.windows[0])
    assert answer.texture_set == plain.model.textures and answer.known and not answer.sure
    assert answer.probabilities.sum() == pytest.approx(1.0)


def test_an_answer_is_sure_from_the_threshold_on() -> None:
    strict = FingerClassifier(CLASSIFIER.model, error_rate=0.001)
    assert not any(strict.answer(rates).sure for rates in TESTED.windows)
    assert any(CLASSIFIER.answer(rates).sure for rates in TESTED.windows)


@pytest.mark.parametrize("shape", [(0, 9), (21, 9), (5, 18), (9,)])
def test_windows_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(WrongUse, match="give 1 to 20 of 9 taxels"):
        CLASSIFIER.answer(np.zeros(shape))
