"""Answers while the finger moves: texture, probabilities, set, known or not, sure or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.posteriors import log_posteriors
from rigctl.analysis.finger.classifier import (
    centred_stages,
    nearest_distances,
    stage_features,
)
from rigctl.analysis.finger.confidence import (
    COVERAGE,
    ERROR_RATE,
    FALSE_ALARM,
    Confidence,
    confidence_of,
)
from rigctl.analysis.finger.scans import ScanKind, ScanSet
from rigctl.encoding.scaled_time import feature_vector
from rigctl.errors import WrongUse
from rigctl.session.finger_model_file import FingerModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Ended = NDArray[np.bool_]
Judged = tuple[Floats, NDArray[np.bool_], Floats]


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
