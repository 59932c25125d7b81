"""Accuracy against evidence: how far and how long the finger must move for the right answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.finger.answers import FingerClassifier
from rigctl.analysis.finger.scans import ScanKind, ScanSet
from rigctl.encoding.features import WINDOW_MS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class EvidenceCurve:
    """Mean accuracy over scans after each window of way and each 100 ms.

    ``at_mm``, ``by_mm``: float64 (20,); ``at_s``, ``by_s``: float64 (m,), up to the longest scan.
    A scan without a window counts as a guess; one that has ended keeps its last answer.
    """

    kind: ScanKind
    at_mm: Floats
    by_mm: Floats
    at_s: Floats
    by_s: Floats


def evidence_curve(
    classifiers: Sequence[FingerClassifier], tested: Sequence[ScanSet]
) -> EvidenceCurve:
    """Return the curve of one representation: each classifier with the scans that it tests."""
    kind = ScanKind(classifiers[0].model.representation)
    window_mm, n_windows = tested[0].window_mm, tested[0].n_windows
    longest = max(int(_durations_ms(scans).max()) for scans in tested)
    times_ms = np.arange(WINDOW_MS, longest + WINDOW_MS, WINDOW_MS)
    pairs = list(zip(classifiers, tested, strict=True))
    by_mm = [
        np.mean([_share_right(c, scans, _times_of_window(scans, n), n) for c, scans in pairs])
        for n in range(1, n_windows + 1)
    ]
    by_s = [
        np.mean([_share_right(c, s, np.full(len(s), time_ms), None) for c, s in pairs])
        for time_ms in times_ms.tolist()
    ]
    at_mm = window_mm * np.arange(1.0, n_windows + 1)
    return EvidenceCurve(kind, at_mm, np.array(by_mm), times_ms / 1000.0, np.array(by_s))


def _share_right(
    classifier: FingerClassifier, scans: ScanSet, times_ms: Integers, n_scaled: int | None
) -> float:
    """Return the share of scans with the right answer at a time; ``n_scaled``: known windows."""
    textures = classifier.model.textures
    if ScanKind(classifier.model.representation) is ScanKind.ORIGINAL:
        windows = np.minimum(times_ms // WINDOW_MS, scans.n_time_windows)
        ended = times_ms >= _durations_ms(scans)
    else:
        closed = np.cumsum(scans.real_ms, axis=1) <= times_ms[:, None]
        windows = (closed & (scans.real_ms > 0)).sum(axis=1)
        ended = times_ms >= scans.real_ms.sum(axis=1)
        if n_scaled is not None:
            windows = np.minimum(windows, n_scaled)
    answers = classifier.predict_after(scans, windows, ended)
    right = np.where(answers < 0, 1.0 / len(textures), answers == scans.labels(textures))
    return float(right.mean())


def _times_of_window(scans: ScanSet, n_windows: int) -> Integers:
    """Return the time at which each scan has closed a window, ms, int64 (n,)."""
    times: Integers = scans.real_ms[:, :n_windows].sum(axis=1)
    return times


def _durations_ms(scans: ScanSet) -> Integers:
    """Return the time of each scan's first 20 windows of way, ms, int64 (n,)."""
    durations: Integers = scans.real_ms.sum(axis=1)
    return durations
