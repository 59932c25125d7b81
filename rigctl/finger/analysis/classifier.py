"""The classifier of the live experiment: trained on one session, centred by the next one's mean.

PCA is centred, not standardised, and LDA has pooled covariance and empirical priors, as everywhere.
Each number of windows has a classifier of its own, trained on so many windows of the training
scans; that of all windows is the paper's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.optimize import minimize_scalar
from scipy.special import softmax

from rigctl.analysis.pca_lda import fit_classifier, log_posteriors, whiten
from rigctl.errors import WrongUse
from rigctl.finger.analysis.scans import FingerEncoding, ScanSet
from rigctl.finger.model_file import FingerCalibration, FingerModel
from rigctl.finger.published import COMPONENTS
from rigctl.finger.scaled_time import feature_vector
from rigctl.finger.values import ScanKind
from rigctl.session.model_file import Classifier, TrainingInfo

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
COVERAGE = 0.95
FALSE_ALARM = 0.05
ERROR_RATE = 0.05
N_FOLDS = 5
_LOG_TEMPERATURES = (0.0, 6.0)
"""Bounds; posteriors are never made sharper, which a few trials without an error would ask for."""
Ended = NDArray[np.bool_]
Judged = tuple[Floats, NDArray[np.bool_], Floats]


def train_finger_model(
    scans: ScanSet,
    kind: ScanKind,
    encoding: FingerEncoding,
    training: TrainingInfo,
    components: int = COMPONENTS,
) -> FingerModel:
    """Return a model of training scans, without a calibration.

    Raises :class:`WrongUse` where the scans are too few or of a single texture.
    """
    stages = train_stages(scans, kind, scans.textures, components)
    return FingerModel(
        kind.value,
        scans.textures,
        encoding.parameters,
        encoding.normalisation,
        encoding.reference_um_per_s,
        encoding.sensor,
        stages,
        training,
    )


def train_stages(
    scans: ScanSet, kind: ScanKind, textures: Sequence[str], components: int = COMPONENTS
) -> tuple[Classifier, ...]:
    """Return the classifiers of 1 to 20 windows."""
    if components < 1:
        raise WrongUse("a model needs one component or more")
    labels = scans.labels(textures)
    features = [stage_features(scans, kind, n) for n in range(1, scans.n_windows + 1)]
    return tuple(_fit(rows, labels, components) for rows in features)


def stage_features(scans: ScanSet, kind: ScanKind, n_windows: int) -> Floats:
    """Return the features of the classifier of ``n_windows``, float64 (n, taxels · n_windows).

    That of all windows takes whole scans: for Original their last 20 windows.
    """
    if n_windows == scans.n_windows:
        return scans.features(kind)
    return feature_vector(scans.evidence(kind, n_windows)[:, :n_windows])


def calibrate_finger_model(model: FingerModel, scans: ScanSet) -> FingerModel:
    """Return the model with the mean of a session's calibration trials, and their predictions.

    Raises :class:`WrongUse` for other textures than the model's, or a single trial.
    """
    if scans.textures != model.textures:
        raise WrongUse(
            f"{scans.session} calibrates the textures {', '.join(scans.textures)}, the model knows "
            f"{', '.join(model.textures)}: calibrate with all of them and no other"
        )
    if len(scans) < 2:
        raise WrongUse(f"{scans.session} has one calibration trial: the mean needs more")
    kind = ScanKind(model.representation)
    mean = scans.features(kind).mean(axis=0)
    labels = scans.labels(model.textures)
    scores = [
        _score_left_out(stage, stage_features(scans, kind, n))
        for n, stage in enumerate(model.stages, start=1)
    ]
    logs, distances = (np.stack(part) for part in zip(*scores, strict=True))
    return replace(model, calibration=FingerCalibration(mean, labels, logs, distances))


def centred_stages(model: FingerModel, stages_mean: Floats | None = None) -> list[Classifier]:
    """Return the classifiers with the calibration's mean in place of the training mean.

    ``stages_mean``: another mean of whole scans, float64 (p,).
    """
    if stages_mean is None:
        if model.calibration is None:
            return list(model.stages)
        stages_mean = model.calibration.mean
    windows = stages_mean.reshape(model.n_taxels, -1)
    return [
        replace(stage, mean=np.ascontiguousarray(windows[:, :n]).reshape(-1))
        for n, stage in enumerate(model.stages, start=1)
    ]


def nearest_distances(classifier: Classifier, features: Floats) -> Floats:
    """Return each row's squared distance to the nearest class, float64 (n,).

    In units of the spread within a class, over the model's components.
    """
    white = whiten(classifier, features)
    offsets = white[:, :, None] - classifier.whitened_means
    return np.asarray((offsets * offsets).sum(axis=1).min(axis=1))


def board_coefficients(model: FingerModel) -> tuple[Floats, Floats]:
    """Return what the board's classifier takes: (classes, components) and (classes,), float64.

    Discriminants are coefficients · scores + intercepts, for whole scans.
    """
    stage = model.stages[-1]
    factor, means = stage.factor.copy(), stage.whitened_means.copy()
    factor[stage.dropped, stage.dropped] = 1.0
    means[stage.dropped] = 0.0
    solved = linalg.solve_triangular(factor, means, lower=True, trans="T")
    solved[stage.dropped] = 0.0
    intercepts = stage.log_priors - 0.5 * (means * means).sum(axis=0)
    return np.ascontiguousarray(solved.T), intercepts


def check_finger_model(model: FingerModel, encoding: FingerEncoding) -> None:
    """Raise :class:`WrongUse` for a model of another sensor, ranges, encoder or reference speed."""
    same_ranges = model.normalisation.has_ranges_of(encoding.normalisation)
    for equal, what in (
        (model.sensor == encoding.sensor, f"the sensor {model.sensor!r}, not {encoding.sensor!r}"),
        (same_ranges, "other taxel ranges"),
        (model.parameters == encoding.parameters, "other encoder parameters"),
        (
            model.reference_um_per_s == encoding.reference_um_per_s,
            f"a reference speed of {model.reference_um_per_s / 1000:g} mm/s, not "
            f"{encoding.reference_um_per_s / 1000:g}",
        ),
    ):
        if not equal:
            raise WrongUse(f"the model was trained with {what}: train one for this finger")


def _fit(features: Floats, labels: Integers, components: int) -> Classifier:
    most = min(len(features) - len(np.unique(labels)), features.shape[1], components)
    if most < 1:
        raise WrongUse(f"{len(features)} training trials are too few for a classifier: record more")
    return Classifier(*fit_classifier(features, labels, most))


def _score_left_out(stage: Classifier, features: Floats) -> tuple[Floats, Floats]:
    """Return log posteriors and distances of trials, each centred by the mean of the others."""
    n, mean = len(features), features.mean(axis=0)
    # x less the mean of the others is n / (n − 1) times x less the mean of all.
    centred = mean + (features - mean) * (n / (n - 1))
    moved = replace(stage, mean=mean)
    return log_posteriors(moved, centred), nearest_distances(moved, centred)


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


@dataclass(frozen=True, slots=True)
class FingerAnswer:
    """An answer after ``n_windows``. ``texture``: the most probable of the trained ones.

    ``probabilities``: float64 (classes,), in the order of the model's textures. ``texture_set``:
    holds the true texture with the coverage that was asked for. ``known``: False where the scan is
    unlike every trained texture, with ``novelty_p`` the share of known scans so unlike. ``sure``:
    whether the answer keeps the error rate that was asked for. Without a calibration the set holds
    all textures, every scan is known, and no answer is sure.
    """

    texture: str
    probabilities: Floats
    texture_set: tuple[str, ...]
    novelty_p: float
    known: bool
    sure: bool
    n_windows: int


class ScanPredictions(NamedTuple):
    """Predictions for scans after 1 … 20 windows.

    ``probabilities``: float64 (windows, n, classes); ``sets``: bool, the same shape; ``novelty_p``:
    float64 (windows, n). ``confidence``: None without a calibration.
    """

    probabilities: Floats
    sets: NDArray[np.bool_]
    novelty_p: Floats
    confidence: Confidence | None


class FingerClassifier:
    """Answers of a model. Its classifiers are centred by the model's calibration, if it has one."""

    def __init__(
        self,
        model: FingerModel,
        *,
        coverage: float = COVERAGE,
        false_alarm: float = FALSE_ALARM,
        error_rate: float = ERROR_RATE,
    ) -> None:
        self.model = model
        self._stages = centred_stages(model)
        self.confidence: Confidence | None = None
        if model.calibration is not None:
            self.confidence = confidence_of(
                model.calibration,
                coverage=coverage,
                false_alarm=false_alarm,
                error_rate=error_rate,
            )

    def answer(self, rates_hz: Floats, *, whole: bool = False) -> FingerAnswer:
        """Return the answer to the windows so far, float64 (k, n_taxels) in Hz, k from 1 to 20.

        With ``whole`` the scan has ended: missing windows count as 0. Raises :class:`WrongUse` for
        another shape.
        """
        n_windows = self.model.n_windows if whole else len(rates_hz)
        padded = self._padded(rates_hz, n_windows)
        stage = self._stages[n_windows - 1]
        features = feature_vector(padded)[None]
        logs, distance = log_posteriors(stage, features), nearest_distances(stage, features)
        probabilities, inside, novelty_p = self._judge(n_windows, logs, distance)
        textures, best = self.model.textures, int(probabilities[0].argmax())
        confidence = self.confidence
        return FingerAnswer(
            textures[best],
            probabilities[0],
            tuple(name for name, held in zip(textures, inside[0], strict=True) if held),
            float(novelty_p[0]),
            bool(confidence is None or novelty_p[0] > confidence.false_alarm),
            bool(confidence is not None and probabilities[0, best] >= confidence.threshold),
            n_windows,
        )

    def predict_after(self, scans: ScanSet, n_windows: Integers, ended: Ended) -> Integers:
        """Return the class index of each scan after ``n_windows`` int64 (n,), or at its end.

        ``ended``: bool (n,). Original may have more than 20 windows behind it. −1 where there is no
        window yet.
        """
        kind = ScanKind(self.model.representation)
        most = self.model.n_windows
        rates = np.where(ended[:, None], scans.features(kind), 0.0)
        rates[~ended] = feature_vector(scans.evidence(kind, n_windows))[~ended]
        stage = np.where(ended, most, np.minimum(n_windows, most))
        found = np.full(len(scans), -1, np.int64)
        for number in np.unique(stage[stage > 0]).tolist():
            rows = stage == number
            features = rates[rows].reshape(-1, self.model.n_taxels, most)[:, :, :number]
            logs = log_posteriors(self._stages[number - 1], features.reshape(len(features), -1))
            found[rows] = logs.argmax(axis=1)
        return found

    def predict(self, features: Floats) -> Integers:
        """Return the class index of whole scans: features float64 (n, p) → int64 (n,)."""
        return np.asarray(log_posteriors(self._stages[-1], features).argmax(axis=1))

    def predict_scans(self, scans: ScanSet) -> ScanPredictions:
        """Return the predictions for recorded scans after every number of windows."""
        kind, judged = ScanKind(self.model.representation), []
        for n_windows, stage in enumerate(self._stages, start=1):
            features = stage_features(scans, kind, n_windows)
            logs, distances = log_posteriors(stage, features), nearest_distances(stage, features)
            judged.append(self._judge(n_windows, logs, distances))
        probabilities, sets, novelty_p = zip(*judged, strict=True)
        return ScanPredictions(
            np.stack(probabilities), np.stack(sets), np.stack(novelty_p), self.confidence
        )

    def _judge(self, n_windows: int, logs: Floats, distances: Floats) -> Judged:
        """Return probabilities, sets and novelty of rows."""
        if self.confidence is None:
            probabilities = np.exp(logs)
            return probabilities, np.ones_like(probabilities, bool), np.ones(len(logs))
        probabilities = self.confidence.probabilities(n_windows, logs)
        sets = self.confidence.texture_sets(n_windows, probabilities)
        return probabilities, sets, self.confidence.novelty_p(n_windows, distances)

    def _padded(self, rates_hz: Floats, n_windows: int) -> Floats:
        rates = np.asarray(rates_hz, np.float64)
        most, taxels = self.model.n_windows, self.model.n_taxels
        if rates.ndim != 2 or rates.shape[1] != taxels or not 1 <= len(rates) <= most:
            raise WrongUse(
                f"windows of shape {rates.shape} do not fit the model: give 1 to {most} of "
                f"{taxels} taxels"
            )
        return np.pad(rates, ((0, n_windows - len(rates)), (0, 0)))
