"""How sure an answer is: probabilities, sets that hold the texture, unknown plates, when to answer.

All of it comes from the session's own calibration trials, whose textures are known and whose
conditions are those of the trials to come. Trials of the training session would promise too much.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import softmax

from rigctl.errors import WrongUse
from rigctl.session.finger_model_file import FingerCalibration

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

COVERAGE = 0.95
FALSE_ALARM = 0.05
ERROR_RATE = 0.05
N_FOLDS = 5
_LOG_TEMPERATURES = (0.0, 6.0)
"""Bounds; posteriors are never made sharper, which a few trials without an error would ask for."""


@dataclass(frozen=True, slots=True)
class Confidence:
    """What a calibration promises after each number of windows; index 0 is one window.

    ``temperatures``: float64 (windows,); log posteriors are divided by them. ``limits``: float64
    (windows,), classes of at least ``1 − limit`` are in the set. ``distances``: sorted, float64
    (windows, n). ``threshold``: the probability from which an answer is given, above 1 where the
    calibration trials are too few or too wrong for the error rate that was asked for.
    """

    temperatures: Floats
    limits: Floats
    distances: Floats
    threshold: float
    false_alarm: float

    def probabilities(self, n_windows: int, logs: Floats) -> Floats:
        """Return calibrated probabilities: log posteriors (…, classes) → (…, classes)."""
        return np.asarray(softmax(logs / self.temperatures[n_windows - 1], axis=-1))

    def texture_sets(self, n_windows: int, probabilities: Floats) -> NDArray[np.bool_]:
        """Return which classes are in each set, bool (…, classes); the best one always is."""
        inside = 1.0 - probabilities <= self.limits[n_windows - 1]
        best = probabilities == probabilities.max(axis=-1, keepdims=True)
        return np.asarray(inside | best)

    def novelty_p(self, n_windows: int, distances: Floats) -> Floats:
        """Return the share of calibration trials, and this one, that lie as far off, float64."""
        known = self.distances[n_windows - 1]
        as_far = len(known) - np.searchsorted(known, distances, side="left")
        return np.asarray((1.0 + as_far) / (len(known) + 1.0))

    def is_known(self, n_windows: int, distances: Floats) -> NDArray[np.bool_]:
        """Return whether a scan is of a trained texture; ``false_alarm`` of those are refused."""
        return np.asarray(self.novelty_p(n_windows, distances) > self.false_alarm)

    @property
    def can_answer(self) -> bool:
        """Whether the calibration supports any answer at the error rate that was asked for."""
        return self.threshold <= 1.0


def confidence_of(
    calibration: FingerCalibration,
    *,
    coverage: float = COVERAGE,
    false_alarm: float = FALSE_ALARM,
    error_rate: float = ERROR_RATE,
) -> Confidence:
    """Return what calibration trials promise. Raises :class:`WrongUse` for shares not in (0, 1)."""
    for name, share in (
        ("coverage", coverage),
        ("share of false alarms", false_alarm),
        ("error rate", error_rate),
    ):
        if not 0.0 < share < 1.0:
            raise WrongUse(f"{name} {share:g} is impossible: give one between 0 and 1")
    labels = calibration.labels
    temperatures = np.array([_temperature(logs, labels) for logs in calibration.logs])
    probabilities = _left_out_probabilities(calibration)
    true = np.take_along_axis(probabilities, labels[None, :, None], axis=2)[..., 0]
    limits = np.array([conformal_limit(1.0 - row, coverage) for row in true])
    threshold = decision_threshold(probabilities, labels, error_rate)
    distances = np.sort(calibration.distances, axis=1)
    return Confidence(temperatures, limits, distances, threshold, false_alarm)


def conformal_limit(scores: Floats, coverage: float) -> float:
    """Return the limit that a new exchangeable score keeps with probability ``coverage``.

    Split conformal prediction (Vovk et al. 2005; Angelopoulos and Bates 2023, equation 1);
    infinite where the scores are too few.
    """
    rank = ceil((len(scores) + 1) * coverage)
    return float(np.sort(scores)[rank - 1]) if rank <= len(scores) else float("inf")


def decision_threshold(probabilities: Floats, labels: Integers, error_rate: float) -> float:
    """Return the lowest probability at which answers would be wrong no more often than asked.

    ``probabilities``: after each number of windows, float64 (windows, n, classes). A trial's
    answer is the first class to reach the threshold. As in selection by conformal p-values (Jin
    and Candès 2023), one more wrong answer is counted than was seen; thresholds are tried from the
    highest on, until one fails. Above 1 where none is low enough: an error rate of e needs 1/e
    right answers.
    """
    best = probabilities.max(axis=2)
    lowest = float(np.nextafter(1.0, 2.0))
    for threshold in np.unique(best)[::-1].tolist():
        answered, answers, _ = sequential_answers(probabilities, threshold)
        allowed = error_rate * int(answered.sum())
        wrong = int((answers[answered] != labels[answered]).sum())
        if allowed >= 1 and 1 + wrong > allowed:
            break
        if allowed >= 1:
            lowest = threshold
    return lowest


def sequential_answers(
    probabilities: Floats, threshold: float
) -> tuple[NDArray[np.bool_], Integers, Integers]:
    """Return which trials are answered, the class of each, and its number of windows.

    ``probabilities``: float64 (windows, n, classes). An unanswered trial has its last best class.
    """
    sure = probabilities.max(axis=2) >= threshold
    answered = sure.any(axis=0)
    first = np.where(answered, sure.argmax(axis=0), len(sure) - 1)
    answers = probabilities[first, np.arange(probabilities.shape[1])].argmax(axis=1)
    return answered, answers.astype(np.int64), first.astype(np.int64) + 1


def _left_out_probabilities(calibration: FingerCalibration) -> Floats:
    """Return the probabilities of calibration trials, float64 (windows, n, classes).

    The temperatures of each fold are those of the other folds: with their own, trials would look
    surer than trials to come.
    """
    logs, labels = calibration.logs, calibration.labels
    fold = np.arange(len(labels)) % min(N_FOLDS, len(labels))
    probabilities = np.empty_like(logs)
    for number in np.unique(fold):
        inside = fold == number
        others = [_temperature(window[~inside], labels[~inside]) for window in logs]
        scaled = logs[:, inside] / np.array(others)[:, None, None]
        probabilities[:, inside] = softmax(scaled, axis=2)
    return probabilities


def _temperature(logs: Floats, labels: Integers) -> float:
    """Return the temperature at which the true classes are most probable (Guo et al. 2017)."""

    def surprise(log_temperature: float) -> float:
        scaled = logs / np.exp(log_temperature)
        top = scaled.max(axis=1)
        normal = np.log(np.exp(scaled - top[:, None]).sum(axis=1)) + top
        return float((normal - scaled[np.arange(len(labels)), labels]).mean())

    found = minimize_scalar(surprise, bounds=_LOG_TEMPERATURES, method="bounded")
    return float(np.exp(found.x))
