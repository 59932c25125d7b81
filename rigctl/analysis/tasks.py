"""The tasks of Figure 3: each representation and number of components over repeated draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.further_tasks import OFFERED, TASK_FAMILIES, tasks_of
from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.representations import Representation, RepresentationSet
from rigctl.analysis.settings import AsteriskThresholds
from rigctl.analysis.splits import (
    UNTRAINED_SPEED,
    extrapolation_fits,
    make_splits,
    textures_left_out,
)
from rigctl.analysis.trial_set import Design
from rigctl.errors import WrongUse

Counts = NDArray[np.int64]
TASK_NAMES = tuple(name for name, _ in OFFERED)


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """The user's settings. ``tasks``: from :data:`TASK_NAMES`, empty for all that fit the set."""

    iterations: int = published.ITERATIONS
    k_max: int = published.K_MAX
    seed: int = 0
    engine: SweepEngine = SweepEngine.OWN
    tasks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.k_max < 1 or self.seed < 0:
            raise WrongUse("iterations and components must be at least 1, the seed at least 0")
        for task in self.tasks:
            if task not in TASK_NAMES:
                raise WrongUse(f"no task {task!r}: choose from {', '.join(TASK_NAMES)}")
            TASK_FAMILIES.load(task)


@dataclass(frozen=True, slots=True)
class Curve:
    """The results of one representation in one task.

    ``accuracy``: float64 (iterations, k_max), shares of ``n_tested`` trials in each iteration.
    ``confusion``: int64 (classes, classes) with 50 components (k_max where that is less), summed
    over iterations; rows: true. ``n_without_variance``: most components without within-class
    variance in a fit; ``beyond_rank``: most components missing in a fit's training trials.
    """

    representation: Representation
    accuracy: NDArray[np.float64]
    confusion: Counts
    n_tested: int
    n_without_variance: int
    beyond_rank: int

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean over iterations, float64 (k_max,)."""
        mean: NDArray[np.float64] = self.accuracy.mean(axis=0)
        return mean

    @property
    def sd(self) -> NDArray[np.float64] | None:
        """Standard deviation over iterations (divisor n − 1), None for a single one."""
        if len(self.accuracy) < 2:
            return None
        sd: NDArray[np.float64] = self.accuracy.std(axis=0, ddof=1)
        return sd


@dataclass(frozen=True, slots=True)
class TaskResult:
    """The results of all representations in one task.

    ``n_train``: trials of the smallest fit; ``thresholds``: of the tests of differences.
    """

    task: published.Task
    classes: tuple[str, ...]
    k_max: int
    n_train: int
    largest_class_share: float
    curves: tuple[Curve, ...]
    thresholds: AsteriskThresholds = field(default_factory=AsteriskThresholds)

    def curve(self, key: str) -> Curve | None:
        """Return the curve of one representation, None where it is absent."""
        return next((c for c in self.curves if c.representation.key == key), None)

    @property
    def shown_components(self) -> int:
        """Components for a single figure of accuracy: the paper's 50, or as many as there are."""
        return min(published.K_MAX, self.k_max)

    @property
    def chance(self) -> float:
        """One over the number of classes, as the paper states it."""
        return 1.0 / len(self.classes)


class _FamilyPlan(NamedTuple):
    """A family of splits with its tasks; ``n_train``: trials of the smallest fit."""

    family: str
    tasks: tuple[published.Task, ...]
    k_max: int
    n_train: int


class _SweepJob(NamedTuple):
    features: Path
    design: Design
    plan: _FamilyPlan
    settings: SweepSettings
    iteration: int


class Score(NamedTuple):
    """The result of one task over some splits.

    ``correct``: int64 (k_max,), of ``n_tested`` trials; the others as in :class:`Curve`.
    """

    correct: Counts
    confusion: Counts
    n_tested: int
    n_without_variance: int
    beyond_rank: int


def run_tasks(
    representations: RepresentationSet,
    settings: SweepSettings,
    resources: Resources = SERIAL_RESOURCES,
) -> tuple[list[TaskResult], tuple[str, ...]]:
    """Return the results of the tasks that fit the trials, and remarks on omissions and changes.

    Raises :class:`WrongUse` where no task is left.
    """
    design = Design.from_trials(representations.trials, representations.settings)
    plans, remarks = _plan_families(design, representations, settings)
    runs = [(plan, representation) for plan in plans for representation in representations.present]
    jobs = [
        _SweepJob(representations.files[representation.key], design, plan, settings, iteration)
        for plan, representation in runs
        for iteration in range(settings.iterations)
    ]
    scores = resources.map(_score, jobs, "classifying")
    draws = {run: [next(scores) for _ in range(settings.iterations)] for run in runs}
    results = []
    for plan in plans:
        for task in plan.tasks:
            curves = [
                _make_curve(
                    representation, [draw[task.key] for draw in draws[plan, representation]]
                )
                for representation in representations.present
            ]
            results.append(_make_result(design, plan, task, curves))
    return results, remarks


def _plan_families(
    design: Design, representations: RepresentationSet, settings: SweepSettings
) -> tuple[list[_FamilyPlan], tuple[str, ...]]:
    plans: list[_FamilyPlan] = []
    remarks: list[str] = []
    remounted = any(trial.mount > 1 for trial in representations.trials.trials)
    for family, tasks in _tasks_by_family(design, settings, remarks, remounted).items():
        try:
            plan = _plan_family(design, representations, settings, family, tasks)
        except WrongUse as reason:
            remarks.append(f"{_join_titles(tasks)}: left out, {reason}")
            continue
        plans.append(plan)
        if textures := textures_left_out(design, family):
            remarks.append(
                f"{_join_titles(plan.tasks)}: textures left out for too few trials to train and "
                f"test with: {', '.join(textures)}"
            )
        absent = [task for task in tasks if task not in plan.tasks]
        if absent:
            remarks.append(f"{_join_titles(absent)}: left out, no trial is left to test")
    if not plans:
        raise WrongUse("; ".join(remarks) or "there is no task to run")
    plugins = map(TASK_FAMILIES.plugin, settings.tasks)
    remarks += [f"{plugin.name}: split by the {plugin}" for plugin in plugins if plugin]
    remarks += [
        f"{_join_titles(plan.tasks)}: up to {plan.k_max} components instead of {settings.k_max}, "
        f"as {plan.n_train} training trials allow"
        for plan in plans
        if plan.k_max < settings.k_max
    ]
    return plans, tuple(remarks)


def _join_titles(tasks: Sequence[published.Task]) -> str:
    return ", ".join(task.title.lower() for task in tasks)


def _tasks_by_family(
    design: Design, settings: SweepSettings, remarks: list[str], remounted: bool
) -> dict[str, tuple[published.Task, ...]]:
    """Return the tasks by family: the requested ones, or all that fit the set.

    ``remounted``: whether a session mounted a plate again. Sessions that each mounted a plate once
    allow the task of mountings, too, but only where it is requested.
    """
    mounts = ("leave-mount-out",) if remounted else ()
    names = settings.tasks or (*_default_names(design, remarks), *mounts)
    extrapolates = extrapolation_fits(design)
    families: dict[str, tuple[published.Task, ...]] = {}
    for task in tasks_of(settings.tasks):
        if (task.family if task.family != "folds" else task.key) not in names:
            continue
        if task.key.endswith(UNTRAINED_SPEED) and not extrapolates:
            continue
        if task.grouped and len(design.groups) < 2:
            remarks.append(
                "texture groups: left out, they need textures of two groups or more: plates A to "
                "P, or those that an analysis file (--settings) names under [groups]"
            )
            continue
        if task.grouped and design.ungrouped:
            listed = ", ".join(design.ungrouped)
            remarks.append(f"texture groups: textures left out for having no group: {listed}")
        families[task.family] = (*families.get(task.family, ()), task)
    return families


def _default_names(design: Design, remarks: list[str]) -> tuple[str, ...]:
    if extrapolation_fits(design):
        return ("textures", "groups", "extrapolation")
    remarks.append(
        f"the extrapolation (trained on {design.settings.conditions.training_text}, tested on "
        "other speeds and forces) does not fit this set: each speed and each force is left out in "
        "turn"
    )
    left_out = [
        name
        for name, levels in (
            ("leave-speed-out", design.speed_mm_s),
            ("leave-force-out", design.force_g),
        )
        if len(np.unique(levels)) > 1
    ]
    return ("textures", "groups", *left_out)


def _plan_family(
    design: Design,
    representations: RepresentationSet,
    settings: SweepSettings,
    family: str,
    tasks: tuple[published.Task, ...],
) -> _FamilyPlan:
    """Plan a family with as many components as its smallest fit allows. Raises WrongUse."""
    fits = make_splits(design, family, settings.seed, 0)
    n_train = min(len(fit.train) for fit in fits)
    narrowest = min(
        layout.n_features(representations.trials.n_taxels)
        for layout in (representations.unscaled, representations.scaled)
    )
    n_textures = max(len(np.unique(design.texture[fit.train])) for fit in fits)
    k_max = min(settings.k_max, n_train - n_textures, narrowest)
    if k_max < 1:
        raise WrongUse(f"{n_train} training trials are too few for {n_textures} textures")
    tested = {key for fit in fits for key in fit.tests}
    remaining = tuple(task for task in tasks if task.key in tested)
    if not remaining:
        raise WrongUse("no trial is left to test")
    return _FamilyPlan(family, remaining, k_max, n_train)


def _score(job: _SweepJob) -> dict[str, Score]:
    """Score one iteration of a family on one representation."""
    features = np.load(job.features, mmap_mode="r")
    plan, settings = job.plan, job.settings
    splits = make_splits(job.design, plan.family, settings.seed, job.iteration)
    return score_splits(features, job.design, splits, plan.tasks, plan.k_max, settings.engine)


def score_splits(
    features: NDArray[np.float64],
    design: Design,
    splits: Sequence[Split],
    tasks: Sequence[published.Task],
    k_max: int,
    engine: SweepEngine = SweepEngine.OWN,
) -> dict[str, Score]:
    """Return the score of each task, by key: features float64 (n_trials, width).

    At least one split tests each task.
    """
    labels = {task.key: design.labels(task) for task in tasks}
    fits = predict_splits(features, labels, splits, k_max, engine)
    unused = max(fit.without_variance for fit in fits), max(fit.beyond_rank for fit in fits)
    scores = {}
    for task in tasks:
        key, n_classes = task.key, len(design.classes(task))
        tested = np.concatenate([split.tests[key] for split in splits if key in split.tests])
        truth, predictions = labels[key][tested], [fit.predictions.get(key) for fit in fits]
        predicted = np.concatenate([part for part in predictions if part is not None], axis=1)
        confusion = np.zeros((n_classes, n_classes), np.int64)
        np.add.at(confusion, (truth, predicted[min(published.K_MAX, k_max) - 1]), 1)
        correct = (predicted == truth).sum(axis=1)
        scores[key] = Score(correct, confusion, len(truth), *unused)
    return scores


def _make_curve(representation: Representation, scores: Sequence[Score]) -> Curve:
    return Curve(
        representation,
        np.array([score.correct / score.n_tested for score in scores]),
        np.sum([score.confusion for score in scores], axis=0),
        scores[0].n_tested,
        max(score.n_without_variance for score in scores),
        max(score.beyond_rank for score in scores),
    )


def _make_result(
    design: Design, plan: _FamilyPlan, task: published.Task, curves: Sequence[Curve]
) -> TaskResult:
    tested = curves[0].confusion.sum(axis=1)
    share = float(tested.max() / tested.sum())
    thresholds = design.settings.statistics
    classes = design.classes(task)
    return TaskResult(task, classes, plan.k_max, plan.n_train, share, tuple(curves), thresholds)
