"""Figures 4B, 4C and S5: accuracy for every number of components, over draws and data sets.

A draw has the same training and test trials in both representations. A new session's trials are
centred by the mean of its calibration, in place of the training trials' mean.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.pca_lda import Rows, Split, SweepEngine, predict_splits
from rigctl.analysis.settings import AnalysisSettings, AsteriskThresholds
from rigctl.analysis.splits import stratified_folds
from rigctl.analysis.statistics import (
    PAIRED,
    Difference,
    standard_deviation,
    standard_error,
    two_proportions,
    welch_each,
)
from rigctl.errors import WrongUse
from rigctl.finger import published
from rigctl.finger.analysis.scans import KINDS, FingerDataSet, ScanSet, common_kinds
from rigctl.finger.analysis.settings import FingerAnalysisSettings
from rigctl.finger.published import (
    DEPLOYED,
    FINGER_TASKS,
    NEW_SESSION,
    SAME_SESSION,
    TRAINED,
    UNTRAINED,
    FingerTask,
)
from rigctl.finger.values import ScanKind

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
STAGE = "classifying draws"
CHUNK = 5
"""Draws of one task."""


@dataclass(frozen=True, slots=True)
class DrawSettings:
    """``draws``: of each data set; ``analysis``: shares, profiles, sizes."""

    draws: int = published.DRAWS
    seed: int = 0
    engine: SweepEngine = SweepEngine.OWN
    analysis: AnalysisSettings = field(default_factory=AnalysisSettings)

    @property
    def finger(self) -> FingerAnalysisSettings:
        """The constants of the real-time experiment."""
        settings: FingerAnalysisSettings = self.analysis.finger
        return settings

    def __post_init__(self) -> None:
        if self.draws < 1:
            raise WrongUse("the analysis needs one draw or more")


@dataclass(frozen=True, slots=True)
class FingerResult:
    """Accuracies of a task. ``accuracy``: of each kind, float64 (draws of all sets, k_max).

    ``n_tested``: trials that a draw tests; ``n_train``: that it trains on, at least;
    ``thresholds``: of the tests of differences. ``n_of_runs``: trials of each kind where each was
    tested in runs of its own, as in the paper's Figure S5; else empty.
    """

    task: FingerTask
    accuracy: dict[ScanKind, Floats]
    n_tested: int
    n_train: int
    chance: float
    thresholds: AsteriskThresholds = field(default_factory=AsteriskThresholds)
    n_of_runs: Mapping[ScanKind, int] = field(default_factory=dict)

    def tested(self, kind: ScanKind) -> int:
        """Return how many trials all draws of a kind test."""
        return self.n_of_runs.get(kind) or len(self.accuracy[kind]) * self.n_tested

    @property
    def k_max(self) -> int:
        """The largest number of components."""
        return int(self.accuracy[ScanKind.ORIGINAL].shape[1])

    def mean(self, kind: ScanKind) -> Floats:
        """Return the mean accuracy for each number of components, float64 (k_max,)."""
        return np.asarray(self.accuracy[kind].mean(axis=0))

    def sd(self, kind: ScanKind) -> Floats | None:
        """Return the standard deviation over draws, float64 (k_max,); None for a single one."""
        return standard_deviation(self.accuracy[kind])

    def standard_error(self, kind: ScanKind) -> Floats | None:
        """Return the standard error of the mean over draws, or of a share for a single fit a set.

        float64 (k_max,); None for a single draw, which has no spread.
        """
        if self.task is not DEPLOYED:
            return standard_error(self.accuracy[kind])
        mean = self.mean(kind)
        return np.asarray(np.sqrt(mean * (1.0 - mean) / self.tested(kind)))

    def differences(self) -> tuple[Difference, ...]:
        """Return Speed Scaled against Original for each number of components."""
        scaled, original = (self.accuracy[kind] for kind in KINDS[::-1])
        if self.task is not DEPLOYED:
            return welch_each(scaled, original, self.thresholds.asterisks)
        n, n_original = (self.tested(kind) for kind in KINDS[::-1])
        counts = (np.rint(self.mean(kind) * self.tested(kind)).astype(int) for kind in KINDS[::-1])
        rule, weak = self.thresholds.proportion_asterisks, () if self.n_of_runs else (PAIRED,)
        return tuple(
            two_proportions(int(one), int(other), n, n_original, rule=rule, weak=weak)
            for one, other in zip(*counts, strict=True)
        )


class _DrawTask(NamedTuple):
    data_set: FingerDataSet
    number: int
    draws: range
    settings: DrawSettings


DrawnAccuracies = dict[tuple[str, ScanKind], list[Floats]]


def run_finger_tasks(
    data_sets: Sequence[FingerDataSet],
    settings: DrawSettings,
    resources: Resources = SERIAL_RESOURCES,
) -> tuple[list[FingerResult], tuple[str, ...]]:
    """Return the results of the tasks that the scans allow, and remarks on the others.

    Raises :class:`WrongUse` where trials are too few.
    """
    obstacle = next(
        filter(None, (_profile_obstacle(one, settings.finger) for one in data_sets)), ""
    )
    tasks = [
        _DrawTask(data_set, number, range(at, min(at + CHUNK, settings.draws)), settings)
        for number, data_set in enumerate(data_sets)
        for at in range(0, settings.draws, CHUNK)
    ]
    found: DrawnAccuracies = {}
    for drawn in resources.map(_draw_accuracies, tasks, STAGE):
        for key, rows in drawn.items():
            found.setdefault(key, []).extend(rows)
    run = [task for task in FINGER_TASKS if not (obstacle and task in (TRAINED, UNTRAINED))]
    results = [_join(task, data_sets, found, settings) for task in run]
    few = [one for one in data_sets if n_folds(one, settings.finger) < settings.finger.folds]
    remarks = [
        f"Figure 4B, same session: {n_folds(one, settings.finger)} folds instead of "
        f"{settings.finger.folds}, as many as the rarest texture of {one.training.session} has "
        "training trials"
        for one in few
    ]
    return results, tuple(filter(None, (obstacle, *remarks)))


def n_folds(data_set: FingerDataSet, settings: FingerAnalysisSettings) -> int:
    """Return the folds of the training trials: no more than its rarest texture has."""
    counts = np.unique(data_set.training.texture, return_counts=True)[1]
    return int(min(settings.folds, counts.min()))


def _profile_obstacle(data_set: FingerDataSet, settings: FingerAnalysisSettings) -> str:
    """Return a sentence where Figure 4C has nothing to train with or to test, else ""."""
    trained, training = ", ".join(settings.trained_profiles), data_set.training
    start = "Figure 4C is left out: it "
    if not len(training.of_profiles(settings.trained_profiles)):
        return (
            f"{start}trains with the velocity profiles {trained}, and {training.session} has no "
            "such scans"
        )
    others = ", ".join(settings.untrained_profiles) or f"others than {trained}"
    for task, profiles in ((TRAINED, trained), (UNTRAINED, others)):
        if not len(_tested(task, data_set, settings)):
            return (
                f"{start}tests the velocity profiles {profiles}, and {data_set.tested.session} has "
                "no such scans"
            )
    return ""


def _join(
    task: FingerTask,
    data_sets: Sequence[FingerDataSet],
    found: DrawnAccuracies,
    settings: DrawSettings,
) -> FingerResult:
    rows = {kind: found[task.key, kind] for kind in common_kinds(data_sets)}
    # Sets of other sizes may allow other numbers of components: the common ones are compared.
    k_max = min(len(row) for each in rows.values() for row in each)
    accuracy = {kind: np.array([row[:k_max] for row in each]) for kind, each in rows.items()}
    tested = min(len(_tested(task, data_set, settings.finger)) for data_set in data_sets)
    n_train = min(_n_train(task, data_set, settings.finger) for data_set in data_sets)
    chance = 1.0 / len(data_sets[0].textures)
    thresholds = settings.analysis.statistics
    of_runs: dict[ScanKind, int] = {}
    if task is DEPLOYED and has_runs_of_each(data_sets):
        of_runs = {k: sum(len(tested_of(one, k)) for one in data_sets) for k in KINDS}
    return FingerResult(task, accuracy, tested, n_train, chance, thresholds, of_runs)


def has_runs_of_each(data_sets: Sequence[FingerDataSet]) -> bool:
    """Return whether every set has runs with and without speed scaling, as the paper made them."""
    names = {kind.value for kind in KINDS}
    return all(names <= set(one.tested.named_by.tolist()) for one in data_sets)


def tested_of(data_set: FingerDataSet, kind: ScanKind) -> Rows:
    """Return the tested scans of one kind's own runs; all where there are not runs of each.

    A kind that the paper does not have is tested on all.
    """
    if kind not in KINDS or not has_runs_of_each([data_set]):
        return np.arange(len(data_set.tested))
    return np.flatnonzero(data_set.tested.named_by == kind.value)


def _tested(task: FingerTask, data_set: FingerDataSet, settings: FingerAnalysisSettings) -> ScanSet:
    if task is SAME_SESSION:
        return data_set.training
    if task not in (TRAINED, UNTRAINED):
        return data_set.tested
    trained, untrained = _profile_masks(data_set.tested, settings)
    return data_set.tested.select(trained if task is TRAINED else untrained)


def _profile_masks(scans: ScanSet, settings: FingerAnalysisSettings) -> tuple[Mask, Mask]:
    """Return which scans have a trained and which an untrained velocity profile, bool (n,)."""
    trained = np.isin(scans.profile, settings.trained_profiles)
    if not settings.untrained_profiles:
        return trained, ~trained
    return trained, np.isin(scans.profile, settings.untrained_profiles)


def _n_train(task: FingerTask, data_set: FingerDataSet, settings: FingerAnalysisSettings) -> int:
    training = data_set.training
    if task in (TRAINED, UNTRAINED):
        training = training.of_profiles(settings.trained_profiles)
    if task is DEPLOYED:
        return len(training)
    return len(training) - round(len(training) * (1.0 - settings.trained_share))


def _draw_accuracies(task: _DrawTask) -> DrawnAccuracies:
    """Return the accuracies of some draws of one data set, by task and kind."""
    found: DrawnAccuracies = {}
    for draw in task.draws:
        seed = [task.settings.seed, task.number, draw]
        for kind in task.data_set.kinds:
            for key, row in draw_accuracies(task.data_set, kind, seed, task.settings):
                found.setdefault((key, kind), []).append(row)
    if 0 in task.draws:
        for kind in task.data_set.kinds:
            accuracy = deployed_accuracy(task.data_set, kind, task.settings)
            found[DEPLOYED.key, kind] = [accuracy]
    return found


def draw_accuracies(
    data_set: FingerDataSet, kind: ScanKind, seed: Sequence[int], settings: DrawSettings
) -> list[tuple[str, Floats]]:
    """Return the accuracies of one draw of Figures 4B and 4C, float64 (k_max,), by task key.

    Figure 4C is absent where the scans lack its velocity profiles.
    """
    random = np.random.default_rng(seed)
    training, finger, engine = data_set.training, settings.finger, settings.engine
    same = _same_session(data_set, kind, random, settings)
    everything = np.arange(len(training))
    train = _draw(everything, random, finger)
    tests = {NEW_SESSION.key: np.arange(len(data_set.tested))}
    new = _new_session(data_set, kind, train, tests, finger.k_max(NEW_SESSION), engine)
    if _profile_obstacle(data_set, finger):
        return [(SAME_SESSION.key, same), *new.items()]
    profiles, _ = _profile_masks(training, finger)
    train = _draw(everything[profiles], random, finger)
    tested = map(np.flatnonzero, _profile_masks(data_set.tested, finger))
    tests = dict(zip((TRAINED.key, UNTRAINED.key), tested, strict=True))
    other = _new_session(data_set, kind, train, tests, finger.k_max(TRAINED), engine)
    return [(SAME_SESSION.key, same), *new.items(), *other.items()]


def deployed_accuracy(data_set: FingerDataSet, kind: ScanKind, settings: DrawSettings) -> Floats:
    """Return the accuracy of Figure S5 in one data set: all training trials, float64 (k_max,)."""
    rows = np.arange(len(data_set.training))
    tests = {DEPLOYED.key: tested_of(data_set, kind)}
    k_max = settings.finger.k_max(DEPLOYED)
    return _new_session(data_set, kind, rows, tests, k_max, settings.engine)[DEPLOYED.key]


class DeployedAnswers(NamedTuple):
    """What Figure S5's classifier calls the tested scans, with ``components`` at most.

    ``confusion``: int64 (textures, textures), rows: true; ``right``, ``tested``: by profile.
    """

    kind: ScanKind
    components: int
    textures: tuple[str, ...]
    confusion: Integers
    right: dict[str, int]
    tested: dict[str, int]


def deployed_answers(
    data_sets: Sequence[FingerDataSet], kind: ScanKind, settings: DrawSettings
) -> DeployedAnswers:
    """Return the answers over all data sets, which have the same textures."""
    textures, components = data_sets[0].textures, settings.finger.components
    confusion = np.zeros((len(textures), len(textures)), np.int64)
    right, tested = Counter[str](), Counter[str]()
    for one in data_sets:
        rows, train = tested_of(one, kind), np.arange(len(one.training))
        given = (one, kind, train, {DEPLOYED.key: rows}, components, settings.engine)
        predicted = predict_new_session(*given)[DEPLOYED.key][-1]
        truth, profiles = one.tested.labels(textures)[rows], one.tested.profile[rows].tolist()
        np.add.at(confusion, (truth, predicted), 1)
        tested.update(profiles)
        right.update(name for name, hit in zip(profiles, predicted == truth, strict=True) if hit)
    known = {name: right[name] for name in tested}
    return DeployedAnswers(kind, components, textures, confusion, known, dict(tested))


def _draw(rows: Rows, random: np.random.Generator, settings: FingerAnalysisSettings) -> Rows:
    """Return three quarters of the rows, whatever their texture, as the paper draws them."""
    return np.sort(random.permutation(rows)[: round(len(rows) * settings.trained_share)])


def _new_session(
    data_set: FingerDataSet,
    kind: ScanKind,
    train: Rows,
    tests: dict[str, Rows],
    k_max: int,
    engine: SweepEngine,
) -> dict[str, Floats]:
    found = predict_new_session(data_set, kind, train, tests, k_max, engine)
    labels = data_set.tested.labels(data_set.textures)
    return {key: (found[key] == labels[rows]).mean(axis=1) for key, rows in tests.items()}


def predict_new_session(
    data_set: FingerDataSet,
    kind: ScanKind,
    train: Rows,
    tests: dict[str, Rows],
    k_max: int,
    engine: SweepEngine = SweepEngine.OWN,
) -> dict[str, Integers]:
    """Train on rows of the training trials and predict rows of the new session's, by task key.

    int64 (k_max, n_test) each, row k − 1 for k components.
    """
    features = data_set.training.features(kind)
    # Replacing the training mean before the projection shifts the new session's features.
    shift = features[train].mean(axis=0) - data_set.calibration.features(kind).mean(axis=0)
    joined = np.concatenate([features, data_set.tested.features(kind) + shift])
    labels = np.concatenate(
        [part.labels(data_set.textures) for part in (data_set.training, data_set.tested)]
    )
    split = Split(train, {key: len(features) + rows for key, rows in tests.items()})
    k_max = _allowed(k_max, labels, [split])
    (found,) = predict_splits(joined, dict.fromkeys(tests, labels), [split], k_max, engine)
    return found.predictions


def _same_session(
    data_set: FingerDataSet, kind: ScanKind, random: np.random.Generator, settings: DrawSettings
) -> Floats:
    """Return the accuracy over the folds of the training trials, float64 (k_max,)."""
    labels = data_set.training.labels(data_set.textures)
    count = n_folds(data_set, settings.finger)
    folds = stratified_folds(labels, count, int(random.integers(2**63)))
    key = SAME_SESSION.key
    splits = [Split(train, {key: test}) for train, test in folds]
    k_max = _allowed(settings.finger.k_max(SAME_SESSION), labels, splits)
    features = data_set.training.features(kind)
    found = predict_splits(features, {key: labels}, splits, k_max, settings.engine)
    right = [
        one.predictions[key] == labels[test] for one, (_, test) in zip(found, folds, strict=True)
    ]
    return np.asarray(np.concatenate(right, axis=1).mean(axis=1))


def _allowed(k_max: int, labels: Integers, splits: Sequence[Split]) -> int:
    """Return the number of components that the smallest training set allows, at most ``k_max``."""
    most = min(len(split.train) - len(np.unique(labels[split.train])) for split in splits)
    if most < 1:
        raise WrongUse(
            "the training trials are too few for a classifier: train with two or more of each "
            "texture"
        )
    return min(k_max, most)
