"""Answers that grow with the scan are those of the recorded scan, and say how sure they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rigctl.errors import WrongUse
from rigctl.finger.analysis.classifier import FingerClassifier
from rigctl.finger.analysis.scans import KINDS, FingerDataSet, ScanSet
from rigctl.finger.values import ScanKind
from tests.finger.analysis.made_scans import made_data_set
from tests.finger.analysis.models import calibrated_model


@cache
def data_set() -> FingerDataSet:
    return made_data_set(1, repeats=4)


@cache
def calibrated() -> FingerClassifier:
    return FingerClassifier(calibrated_model(data_set()))


def run_scans() -> ScanSet:
    return data_set().tested


@pytest.mark.parametrize("kind", KINDS)
def test_live_answers_equal_those_of_recorded_scans(kind: ScanKind) -> None:
    classifier = FingerClassifier(calibrated_model(data_set(), kind))
    predictions = classifier.predict_scans(run_scans())
    for row in (0, 37):
        for n_windows in (1, 9):
            rates = run_scans().evidence(kind, n_windows)[row, :n_windows]
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
    classifier = FingerClassifier(calibrated_model(data_set(), kind))
    row = int(run_scans().n_time_windows.argmin())
    n = int(run_scans().n_time_windows[row])
    assert n < 20
    whole = classifier.answer(run_scans().time_rates[row, :n], whole=True)
    last = classifier.predict_scans(run_scans()).probabilities[-1, row]
    assert whole.probabilities.tobytes() == last.tobytes() and whole.n_windows == 20


def test_answers_after_any_window_follow_the_stages() -> None:
    predictions = calibrated().predict_scans(run_scans()).probabilities.argmax(axis=2)
    running = np.zeros(len(run_scans()), bool)
    for n_windows in (1, 12, 20):
        found = calibrated().predict_after(
            run_scans(), np.full(len(run_scans()), n_windows), running
        )
        assert np.array_equal(found, predictions[n_windows - 1])
    none = np.zeros(len(run_scans()), np.int64)
    assert np.all(calibrated().predict_after(run_scans(), none, running) == -1)
    assert np.array_equal(calibrated().predict_after(run_scans(), none, ~running), predictions[-1])


def test_an_unheard_pattern_is_none_of_the_textures() -> None:
    known = [calibrated().answer(rates).known for rates in run_scans().windows]
    assert np.mean(known) > 0.85
    random = np.random.default_rng(0)
    strange = calibrated().answer(random.uniform(0, 600, (20, 9)))
    assert not strange.known and strange.novelty_p < 0.05


def test_without_a_calibration_nothing_is_promised() -> None:
    plain = FingerClassifier(replace(calibrated().model, calibration=None))
    answer = plain.answer(run_scans().windows[0])
    assert answer.texture_set == plain.model.textures and answer.known and not answer.sure
    assert answer.probabilities.sum() == pytest.approx(1.0)


def test_an_answer_is_sure_from_the_threshold_on() -> None:
    strict = FingerClassifier(calibrated().model, error_rate=0.001)
    assert not any(strict.answer(rates).sure for rates in run_scans().windows)
    assert any(calibrated().answer(rates).sure for rates in run_scans().windows)


@pytest.mark.parametrize("shape", [(0, 9), (21, 9), (5, 18), (9,)])
def test_windows_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(WrongUse, match="give 1 to 20 of 9 taxels"):
        calibrated().answer(np.zeros(shape))
