"""Whether answers keep their promises in sessions that did not train them.

Sets of textures against their coverage, unknown plates, and early answers against their error rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.finger.answers import FingerClassifier
from rigctl.analysis.finger.classifier import (
    FingerEncoding,
    calibrate_finger_model,
    train_finger_model,
)
from rigctl.analysis.finger.confidence import (
    COVERAGE,
    FALSE_ALARM,
    confidence_of,
    sequential_answers,
)
from rigctl.analysis.finger.data_sets import FingerDataSet
from rigctl.analysis.finger.published import COMPONENTS
from rigctl.analysis.finger.scans import ScanKind, ScanSet
from rigctl.analysis.paper.statistics import wilson_interval
from rigctl.encoding.normalisation import Normalisation
from rigctl.session.finger_model_file import FingerModel
from rigctl.session.model_file import TrainingInfo

Floats = NDArray[np.float64]

ERROR_RATES = (0.01, 0.05, 0.10, 0.20)
NOVELTY_STAGE = "leaving textures out"


@dataclass(frozen=True, slots=True)
class SetCoverage:
    """Sets after 1 … 20 windows: share that holds the true texture, mean size, share of all.

    float64 (windows,) each, over ``n`` trials of held-out sessions; ``failures`` are sets of every
    texture, which say nothing.
    """

    kind: ScanKind
    promised: float
    coverage: Floats
    size: Floats
    failures: Floats
    n: int
    n_classes: int

    @property
    def sentence(self) -> str:
        """What whole scans give, in words."""
        text = (
            f"{self.kind.value}: sets that promise {self.promised:.0%} hold the true texture in "
            f"{self.coverage[-1]:.1%} of {self.n} held-out trials, mean size {self.size[-1]:.2f} "
            f"of {self.n_classes}"
        )
        if self.failures[-1]:
            text += f"; FAILURE in {self.failures[-1]:.1%}: the set holds all textures"
        return text


@dataclass(frozen=True, slots=True)
class NoveltyResult:
    """Plates that were never trained, each texture left out in turn.

    ``detected``: share of their scans called unknown after 1 … 20 windows, ``false_alarms``: share
    of scans of trained textures, float64 (windows,); ``area``: under the ROC curve, whole scans.
    """

    kind: ScanKind
    promised: float
    detected: Floats
    false_alarms: Floats
    area: float
    by_texture: dict[str, float]

    @property
    def sentence(self) -> str:
        """What whole scans give, in words."""
        return (
            f"{self.kind.value}: {self.detected[-1]:.1%} of scans of a plate that was never "
            f"trained are called unknown, at {self.false_alarms[-1]:.1%} false alarms "
            f"({self.promised:.0%} asked for); area under the ROC curve {self.area:.2f}"
        )


class SequentialResult(NamedTuple):
    """Answers as soon as they are sure enough, over all held-out trials.

    ``error_rate``: wrong answers among the answers, with its 95 % interval, None without an answer;
    ``answered``: share of trials; ``mean_mm``, ``mean_s``: evidence at the answer;
    ``sets_without``: data sets whose calibration supports no answer.
    """

    kind: ScanKind
    asked: float
    answered: float
    error_rate: float | None
    interval: tuple[float, float] | None
    mean_mm: float | None
    mean_s: float | None
    sets_without: int

    @property
    def kept(self) -> bool | None:
        """Whether the error rate is what was asked for, within its interval; None: no answer."""
        return None if self.interval is None else self.interval[0] <= self.asked


def train_classifier(
    data_set: FingerDataSet, kind: ScanKind, components: int = COMPONENTS
) -> FingerClassifier:
    """Return the classifier of a data set: all its training trials, its calibration."""
    return FingerClassifier(_model(data_set.training, data_set.calibration, kind, components))


def measure_coverage(
    classifiers: Sequence[FingerClassifier], tested: Sequence[ScanSet]
) -> SetCoverage:
    """Return how well the sets of classifiers keep their promise in the scans that each tests."""
    held, sizes = [], []
    for classifier, scans in zip(classifiers, tested, strict=True):
        sets = classifier.predict_scans(scans).sets
        labels = scans.labels(classifier.model.textures)
        held.append(np.take_along_axis(sets, labels[None, :, None], axis=2)[..., 0])
        sizes.append(sets.sum(axis=2))
    size = np.concatenate(sizes, axis=1)
    inside = np.concatenate(held, axis=1)
    model = classifiers[0].model
    n_classes = len(model.textures)
    return SetCoverage(
        ScanKind(model.representation),
        COVERAGE,
        inside.mean(axis=1),
        size.mean(axis=1),
        (size == n_classes).mean(axis=1),
        size.shape[1],
        n_classes,
    )


def measure_novelty(left_out: Sequence[LeftOut]) -> NoveltyResult:
    """Return the detection of unknown plates over all textures and data sets."""
    kinds = {one.kind for one in left_out}
    by_texture = {
        texture: float(np.mean([o.detected[-1] for o in left_out if o.texture == texture]))
        for texture in sorted({one.texture for one in left_out})
    }
    return NoveltyResult(
        kinds.pop(),
        FALSE_ALARM,
        np.mean([one.detected for one in left_out], axis=0),
        np.mean([one.false_alarms for one in left_out], axis=0),
        float(np.mean([one.area for one in left_out])),
        by_texture,
    )


class LeftOutTask(NamedTuple):
    """A texture to leave out of a data set."""

    data_set: FingerDataSet
    kind: ScanKind
    texture: str
    components: int = COMPONENTS


class LeftOut(NamedTuple):
    """Shares of unknown scans after 1 … 20 windows, float64 (windows,), with one texture left out.

    ``detected``: of scans of the texture that was left out; ``false_alarms``: of the others.
    """

    kind: ScanKind
    texture: str
    detected: Floats
    false_alarms: Floats
    area: float


def leave_texture_out(task: LeftOutTask) -> LeftOut:
    """Train and calibrate without a texture; return what its scans and the others' are called."""
    from sklearn.metrics import roc_auc_score

    data_set, kind, texture, components = task
    training, calibration = (
        scans.select(scans.texture != texture)
        for scans in (data_set.training, data_set.calibration)
    )
    found = FingerClassifier(_model(training, calibration, kind, components)).predict_scans(
        data_set.tested
    )
    unknown = found.novelty_p <= FALSE_ALARM
    novel = data_set.tested.texture == texture
    area = float(roc_auc_score(novel, -found.novelty_p[-1]))
    known_share = unknown[:, ~novel].mean(axis=1)
    return LeftOut(kind, texture, unknown[:, novel].mean(axis=1), known_share, area)


def measure_sequential(
    classifiers: Sequence[FingerClassifier], tested: Sequence[ScanSet], asked: float
) -> SequentialResult:
    """Return what answers at an error rate cost and give, over the scans that each tests."""
    parts, sets_without = [], 0
    for classifier, scans in zip(classifiers, tested, strict=True):
        calibration = classifier.model.calibration
        if calibration is None:
            continue
        confidence = confidence_of(calibration, error_rate=asked)
        sets_without += not confidence.can_answer
        probabilities = classifier.predict_scans(scans).probabilities
        answered, answers, windows = sequential_answers(probabilities, confidence.threshold)
        kind = ScanKind(classifier.model.representation)
        parts.append(
            [
                answered,
                answers == scans.labels(classifier.model.textures),
                *_evidence_at(scans, kind, windows),
            ]
        )
    answered, right, at_mm, at_s = (np.concatenate(part) for part in zip(*parts, strict=True))
    kind = ScanKind(classifiers[0].model.representation)
    share = float(answered.mean())
    if not answered.any():
        return SequentialResult(kind, asked, share, None, None, None, None, sets_without)
    n, wrong = int(answered.sum()), int((~right[answered]).sum())
    low, high = wilson_interval(wrong, n)
    mm, seconds = (float(values[answered].mean()) for values in (at_mm, at_s))
    interval = float(low), float(high)
    return SequentialResult(kind, asked, share, wrong / n, interval, mm, seconds, sets_without)


def _evidence_at(scans: ScanSet, kind: ScanKind, windows: NDArray[np.int64]) -> list[Floats]:
    """Return the way in mm and the time in s of each scan's first ``windows``, float64 (n,)."""
    ends_ms = np.cumsum(scans.real_ms, axis=1)
    at = np.arange(len(scans))
    if kind is ScanKind.SPEED_SCALED:
        times_ms = ends_ms[at, windows - 1]
    else:
        # The classifier of all windows speaks at the end of the scan.
        whole = windows >= scans.real_ms.shape[1]
        times_ms = np.where(whole, ends_ms[:, -1], np.minimum(100 * windows, ends_ms[:, -1]))
    passed = (ends_ms <= times_ms[:, None]).sum(axis=1)
    return [scans.window_mm * passed, times_ms / 1000.0]


def _model(training: ScanSet, calibration: ScanSet, kind: ScanKind, components: int) -> FingerModel:
    info = TrainingInfo("", "", "", 0, training.simulated, len(training), (), ())
    ranges = Normalisation.full_scale(training.windows.shape[2])
    encoding = FingerEncoding(ranges, reference_um_per_s=training.reference_um_per_s)
    model = train_finger_model(training, kind, encoding, info, components)
    return calibrate_finger_model(model, calibration)
