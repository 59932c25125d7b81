"""Measurements beyond the paper: evidence, kept promises, force invariance, profiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.statistics import Difference, two_proportions, wilson_interval
from rigctl.encoder.normalisation import Normalisation
from rigctl.finger.analysis.classifier import (
    COVERAGE,
    FALSE_ALARM,
    FingerClassifier,
    calibrate_finger_model,
    confidence_of,
    sequential_answers,
    train_finger_model,
)
from rigctl.finger.analysis.scans import (
    KINDS,
    FingerDataSet,
    FingerEncoding,
    ScanSet,
    common_kinds,
)
from rigctl.finger.analysis.tasks import DrawSettings, deployed_accuracy
from rigctl.finger.model_file import FingerModel
from rigctl.finger.published import COMPONENTS, DEPLOYED
from rigctl.finger.values import ScanKind, VelocityProfile
from rigctl.session.model_file import TrainingInfo

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
NONE_NAME = "no force scaling"
WINDOW_NAME = "rates of each window over their mean of all taxels"
SCAN_NAME = "rates of a scan over their mean of all windows and taxels"
CURRENT_NAME = "current of a scan scaled to equal mean readings"
"""Encoded anew, as the paper scales by C: see :func:`scale_to_population`."""
ERROR_RATES = (0.01, 0.05, 0.10, 0.20)
NOVELTY_STAGE = "leaving textures out"


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
    step_ms = tested[0].window_ms
    times_ms = np.arange(step_ms, longest + step_ms, step_ms)
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
    if not ScanKind(classifier.model.representation).is_speed_scaled:
        windows = np.minimum(times_ms // scans.window_ms, scans.n_time_windows)
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


class ForceComparison(NamedTuple):
    """Accuracy of Figure S5's task with a force scaling, for each kind with 25 components.

    ``accuracy``: over all data sets; ``difference``: from no force scaling, None for that itself.
    """

    scaling: str
    kind: ScanKind
    accuracy: float
    peak: float
    peak_components: int
    difference: Difference | None

    @property
    def p(self) -> float | None:
        """Probability of such a difference without an effect."""
        return None if self.difference is None else self.difference.p

    @property
    def h(self) -> float | None:
        """Cohen's h of the difference."""
        return None if self.difference is None else self.difference.effect

    @property
    def verdict(self) -> str:
        """Whether it helps: p is small enough for an asterisk, however small the effect."""
        if self.difference is None:
            return ""
        most_p = max(most_p for _, most_p, _ in self.difference.rule)
        if self.p is None or self.h is None or self.p >= most_p:
            return "no significant difference"
        return "helps" if self.h > 0 else "harms"


def compare_force_scalings(
    data_sets: Sequence[FingerDataSet],
    scaled_currents: Sequence[FingerDataSet] = (),
    settings: DrawSettings | None = None,
) -> list[ForceComparison]:
    """Return the accuracy with each scaling. ``scaled_currents``: the data sets encoded anew."""
    variants: dict[str, Sequence[FingerDataSet]] = {NONE_NAME: data_sets}
    for name, function in RATE_SCALINGS.items():
        variants[name] = [_map_scans(data_set, function) for data_set in data_sets]
    if scaled_currents:
        variants[CURRENT_NAME] = scaled_currents
    return [one for kind in KINDS for one in _compare(variants, kind, settings or DrawSettings())]


def _compare(
    variants: Mapping[str, Sequence[FingerDataSet]], kind: ScanKind, settings: DrawSettings
) -> list[ForceComparison]:
    n = sum(len(data_set.tested) for data_set in variants[NONE_NAME])
    counts = {
        name: _correct_counts(data_sets, kind, settings) for name, data_sets in variants.items()
    }
    # A gain has made representations of its own, with the time of this one or the other.
    counts |= {
        str(other.force_scaling).capitalize(): _correct_counts(variants[NONE_NAME], other, settings)
        for other in common_kinds(variants[NONE_NAME])
        if other not in KINDS and other.is_speed_scaled == kind.is_speed_scaled
    }
    plain, found = counts[NONE_NAME], []
    rule = settings.analysis.statistics.proportion_asterisks
    shown = min(settings.finger.components, min(map(len, counts.values()))) - 1
    for name, correct in counts.items():
        best = int(correct.argmax())
        difference = None
        if name != NONE_NAME:
            difference = two_proportions(int(correct[shown]), int(plain[shown]), n, rule=rule)
        found.append(
            ForceComparison(name, kind, correct[shown] / n, correct[best] / n, best + 1, difference)
        )
    return found


def _correct_counts(
    data_sets: Sequence[FingerDataSet], kind: ScanKind, settings: DrawSettings
) -> NDArray[np.int64]:
    """Return the number of right answers in all sets, int64 (k_max,)."""
    rows = [deployed_accuracy(one, kind, settings) * len(one.tested) for one in data_sets]
    k_max = min(settings.finger.k_max(DEPLOYED), *map(len, rows))
    total = np.sum([row[:k_max] for row in rows], axis=0)
    return np.asarray(np.rint(total), np.int64)


def over_window_mean(scans: ScanSet) -> ScanSet:
    """Return scans with each window's rates over their mean of all taxels."""
    return replace(
        scans,
        windows=_over_mean(scans.windows, axis=2),
        time_rates=_over_mean(scans.time_rates, axis=2),
    )


def over_scan_mean(scans: ScanSet) -> ScanSet:
    """Return scans with all rates over their mean of the whole scan."""
    return replace(
        scans,
        windows=_over_mean(scans.windows, axis=(1, 2)),
        time_rates=_over_scan_mean(scans.time_rates, scans.n_time_windows),
    )


RATE_SCALINGS: Mapping[str, Callable[[ScanSet], ScanSet]] = {
    WINDOW_NAME: over_window_mean,
    SCAN_NAME: over_scan_mean,
}


def _map_scans(data_set: FingerDataSet, scale: Callable[[ScanSet], ScanSet]) -> FingerDataSet:
    return replace(
        data_set,
        training=scale(data_set.training),
        calibration=scale(data_set.calibration),
        tested=scale(data_set.tested),
    )


def _over_mean(rates: Floats, axis: int | tuple[int, int]) -> Floats:
    """Return rates over their mean along axes, 0 where that is 0."""
    mean = rates.mean(axis=axis, keepdims=True)
    return np.asarray(np.divide(rates, mean, out=np.zeros_like(rates), where=mean > 0))


def _over_scan_mean(rates: Floats, n_windows: NDArray[np.int64]) -> Floats:
    """Return rates float64 (n, w, taxels) over the mean of each scan's own windows."""
    total = rates.sum(axis=(1, 2), keepdims=True)
    mean = total / (np.maximum(n_windows, 1)[:, None, None] * rates.shape[2])
    return np.asarray(np.divide(rates, mean, out=np.zeros_like(rates), where=mean > 0))


@dataclass(frozen=True, slots=True)
class SetCoverage:
    """Sets after 1 … 20 windows: share that holds the true texture, mean size, share of all.

    float64 (windows,) each, over ``n`` trials of held-out sessions; ``failures`` are sets of every
    texture, which say nothing.
    """

    kind: ScanKind
    promised: float
    coverage: Floats
    mean_size: Floats
    failures: Floats
    n: int
    n_classes: int

    @property
    def sentence(self) -> str:
        """What whole scans give, in words."""
        text = (
            f"{self.kind.value}: sets that promise {self.promised:.0%} hold the true texture in "
            f"{self.coverage[-1]:.1%} of {self.n} held-out trials, mean size "
            f"{self.mean_size[-1]:.2f} of {self.n_classes}"
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
    promised_false_alarms: float
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
            f"({self.promised_false_alarms:.0%} asked for); area under the ROC curve "
            f"{self.area:.2f}"
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
        round(float(np.mean([one.area for one in left_out])), 6),
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
    if kind.is_speed_scaled:
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


@dataclass(frozen=True, slots=True)
class ProfileDifferences:
    """Mean rates by profile, over textures and taxels, and shares of the features' variance (η²).

    ``texture_share`` by the texture, ``profile_share`` by the profile within a texture; the rest
    varies between scans of one texture and profile.
    """

    kind: ScanKind
    mean_rate_hz: dict[str, float]
    texture_share: float
    profile_share: float

    @property
    def spread(self) -> float:
        """Largest less smallest mean rate, relative to their mean."""
        rates = np.array(list(self.mean_rate_hz.values()))
        return float(np.ptp(rates) / rates.mean()) if rates.mean() > 0 else 0.0


def profile_differences(scans: ScanSet, kind: ScanKind) -> ProfileDifferences:
    """Return the differences between profiles in a session's scans."""
    features = scans.features(kind)
    names = [str(profile) for profile in VelocityProfile if (scans.profile == profile).any()]
    rates = {name: float(features[scans.profile == name].mean()) for name in names}
    total = _scatter(features, np.zeros(len(scans), np.int64))
    texture = scans.labels(scans.textures)
    both = texture * len(names) + np.array([names.index(p) for p in scans.profile.tolist()])
    within_texture, within_both = _scatter(features, texture), _scatter(features, both)
    if total == 0:
        return ProfileDifferences(kind, rates, 0.0, 0.0)
    return ProfileDifferences(
        kind, rates, 1.0 - within_texture / total, (within_texture - within_both) / total
    )


def _scatter(features: Floats, groups: NDArray[np.int64]) -> float:
    """Return the sum of squared deviations from the mean of each group."""
    return sum(
        float(((rows - rows.mean(axis=0)) ** 2).sum())
        for group in np.unique(groups)
        for rows in [features[groups == group]]
    )
