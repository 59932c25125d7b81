"""Answers while a scan grows: from the board's windows, or from whole 100 ms without scaling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.finger.analysis.classifier import FingerAnswer, FingerClassifier
from rigctl.finger.scaled_time import N_WINDOWS, last_windows, time_windows
from rigctl.finger.scan_in_progress import ScanData, ScanInProgress
from rigctl.finger.values import PredictionRow, ScanKind


class LiveAnswers:
    """Answers of one scan after the other; ``decided`` from the first sure answer of a scan."""

    def __init__(self, classifier: FingerClassifier) -> None:
        self._classifier = classifier
        self._kind = ScanKind(classifier.model.representation)
        self._scan = -1
        self._decided = False

    @property
    def textures(self) -> tuple[str, ...]:
        """Textures that an answer can name."""
        return self._classifier.model.textures

    def answer(self, scan: ScanInProgress, at_s: float) -> PredictionRow | None:
        """Return the answer to the scan so far; None before the first whole window."""
        is_final = scan.ended
        rates_hz = self._rates_hz(scan.data, is_final)
        if not len(rates_hz):
            return None
        if scan.number != self._scan:
            self._scan, self._decided = scan.number, False
        found = self._classifier.answer(rates_hz, whole=is_final)
        self._decided |= found.sure
        return self._row(scan, found, at_s)

    def _rates_hz(self, data: ScanData, is_final: bool) -> NDArray[np.float64]:
        if not self._kind.is_speed_scaled:
            windows = time_windows(data.all_spikes)
            return last_windows(windows)[: min(len(windows.counts), N_WINDOWS)]
        reports = enumerate(data.windows[:N_WINDOWS])
        # A lost report would move all later windows; the scan is refused at its end.
        rates = [report.rates_hz for number, report in reports if report.window == number]
        return np.array(rates, np.float64).reshape(len(rates), -1)

    def _row(self, scan: ScanInProgress, found: FingerAnswer, at_s: float) -> PredictionRow:
        pairs = zip(self.textures, found.probabilities.tolist(), strict=True)
        return PredictionRow(
            scan=scan.number,
            at_s=at_s,
            windows=found.n_windows,
            distance_mm=scan.distance_mm,
            seconds=scan.duration_s,
            texture=found.texture,
            probabilities=dict(sorted(pairs, key=lambda pair: -pair[1])),
            texture_set=found.texture_set,
            known=found.known,
            decided=self._decided,
            is_final=scan.ended,
        )
