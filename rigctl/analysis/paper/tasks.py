"""The tasks of Figure 3: every representation, every number of components, redrawn many times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.splits import Design, extrapolation_fits, make_splits
from rigctl.analysis.classification.sweep_engines import SweepEngine, predict_splits
from rigctl.analysis.execution.executor import SERIAL, Executor, Progress, map_with_progress
from rigctl.analysis.features.representations import Representation, RepresentationSet
from rigctl.analysis.paper import published
from rigctl.errors import WrongUse

Counts = NDArray[np.int64]

CHOICES = ("textures", "groups", "extrapolation", "leave-speed-out", "leave-force-out")


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """What a user may choose. ``tasks``: out of :data:`CHOICES`, empty for all that fit."""

    iterations: int = published.ITERATIONS
    k_max: int = published.K_MAX
    seed: int = 0
    engine: SweepEngine = SweepEngine.OWN
    tasks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.k_max < 1 or self.seed < 0:
            raise WrongUse("iterations and components must be at least 1, the seed at least 0")
        for task in self.tasks:
            if task not in CHOICES:
                raise WrongUse(f"no task {task!r}: choose out of {', '.join(CHOICES)}")


@dataclass(frozen=True, slots=True)
class Curve:
    """One representation in one task.

    ``accuracy``: float64 (iterations, k_max), shares of ``tested`` trials an iteration.
    ``confusion``: int64 (classes, classes) with 50 components (k_max where that is less), summed
    over iterations, rows the truth. ``set_aside``: most components without within-class variance
    in a fit; ``beyond_rank``: most components that a fit's training trials did not have.
    """

    representation: Representation
    accuracy: NDArray[np.float64]
    confusion: Counts
    tested: int
    set_aside: int
    beyond_rank: int

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean over iterations, float64 (k_max,)."""
        mean: NDArray[np.float64] = self.accuracy.mean(axis=0)
        return mean

    @property
    def deviation(self) -> NDArray[np.float64] | None:
        """Standard deviation over iterations (divisor n − 1), None for a single one."""
        if len(self.accuracy) < 2:
            return None
        spread: NDArray[np.float64] = self.accuracy.std(axis=0, ddof=1)
        return spread


@dataclass(frozen=True, slots=True)
class TaskResult:
    """All representations in one task. ``learnt``: training trials of the smallest fit."""

    task: published.Task
    classes: tuple[str, ...]
    k_max: int
    learnt: int
    largest_class: float
    curves: tuple[Curve, ...]

    def curve(self, key: str) -> Curve | None:
        """The curve of one representation, None where that is not there."""
        return next((c for c in self.curves if c.representation.key == key), None)

    @property
    def shown(self) -> int:
        """Components of the single figures of accuracy: the paper's 50, or as many as there are."""
        return min(published.K_MAX, self.k_max)

    @property
    def chance(self) -> float:
        """One over the number of classes, as the paper states it."""
        return 1.0 / len(self.classes)


class _Plan(NamedTuple):
    """A family of splits, with the tasks asked of it."""

    family: str
    tasks: tuple[published.Task, ...]
    k_max: int
    learnt: int


class _SweepJob(NamedTuple):
    features: Path
    design: Design
    plan: _Plan
    settings: SweepSettings
    iteration: int


class _Score(NamedTuple):
    correct: Counts
    confusion: Counts
    tested: int
    set_aside: int
    beyond_rank: int


def run_tasks(
    made: RepresentationSet,
    settings: SweepSettings,
    *,
    executor: Executor = SERIAL,
    progress: Progress = lambda stage, done, all_: None,
) -> tuple[list[TaskResult], tuple[str, ...]]:
    """Results of the tasks that the trials allow, and sentences on what was left out or changed.

    Raises :class:`WrongUse` where no task is left.
    """
    design = Design.from_trials(made.trials)
    plans, remarks = _plans(design, made, settings)
    ways = [(plan, representation) for plan in plans for representation in made.present]
    jobs = [
        _SweepJob(made.files[representation.key], design, plan, settings, iteration)
        for plan, representation in ways
        for iteration in range(settings.iterations)
    ]
    scores = map_with_progress(
        _scored, jobs, executor=executor, stage="classifying", progress=progress
    )
    curves: dict[str, list[Curve]] = {task.key: [] for plan in plans for task in plan.tasks}
    for plan, representation in ways:
        several = [next(scores) for _ in range(settings.iterations)]
        for task in plan.tasks:
            curves[task.key].append(_curve(representation, [s[task.key] for s in several]))
    every = [(plan, task) for plan in plans for task in plan.tasks]
    return [_result(design, plan, task, curves[task.key]) for plan, task in every], remarks


def _plans(
    design: Design, made: RepresentationSet, settings: SweepSettings
) -> tuple[list[_Plan], tuple[str, ...]]:
    plans: list[_Plan] = []
    remarks: list[str] = []
    for family, tasks in _wanted(design, settings, remarks).items():
        try:
            plan = _plan(design, made, settings, family, tasks)
        except WrongUse as reason:
            remarks.append(f"{_listed(tasks)}: left out, {reason}")
            continue
        plans.append(plan)
        absent = [task for task in tasks if task not in plan.tasks]
        if absent:
            remarks.append(f"{_listed(absent)}: left out, no trial is left to be asked")
    if not plans:
        raise WrongUse("; ".join(remarks) or "there is no task to run")
    remarks += [
        f"{_listed(plan.tasks)}: up to {plan.k_max} components instead of {settings.k_max}, as "
        f"{plan.learnt} training trials allow"
        for plan in plans
        if plan.k_max < settings.k_max
    ]
    return plans, tuple(remarks)


def _listed(tasks: Sequence[published.Task]) -> str:
    return " and ".join(task.title.lower() for task in tasks)


def _wanted(
    design: Design, settings: SweepSettings, remarks: list[str]
) -> dict[str, tuple[published.Task, ...]]:
    """Tasks by family: those asked for, or all that suit the set."""
    asked = settings.tasks or _suitable(design, remarks)
    wanted: dict[str, tuple[published.Task, ...]] = {}
    for task in published.TASKS:
        if (task.family if task.family != "folds" else task.key) not in asked:
            continue
        if task.grouped and len(design.groups) < 2:
            remarks.append(
                "texture groups: left out, it needs plates A to P out of two groups or more"
            )
            continue
        wanted[task.family] = (*wanted.get(task.family, ()), task)
    return wanted


def _suitable(design: Design, remarks: list[str]) -> tuple[str, ...]:
    if extrapolation_fits(design):
        return ("textures", "groups", "extrapolation")
    remarks.append(
        "the paper's extrapolation (40, 60, 80 mm/s with 250, 500 g learnt, other speeds and "
        "forces asked) does not fit this set: each speed and each force is left out in turn instead"
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


def _plan(
    design: Design,
    made: RepresentationSet,
    settings: SweepSettings,
    family: str,
    tasks: tuple[published.Task, ...],
) -> _Plan:
    """The family with as many components as its smallest fit carries. Raises WrongUse."""
    fits = make_splits(design, family, settings.seed, 0)
    learnt = min(len(fit.train) for fit in fits)
    narrowest = min(
        layout.n_features(made.trials.n_taxels) for layout in (made.unscaled, made.scaled)
    )
    k_max = min(settings.k_max, learnt - len(design.textures), narrowest)
    if k_max < 1:
        raise WrongUse(f"{learnt} training trials are too few for {len(design.textures)} textures")
    there = {key for fit in fits for key in fit.tests}
    kept = tuple(task for task in tasks if task.key in there)
    if not kept:
        raise WrongUse("no trial is left to be asked")
    return _Plan(family, kept, k_max, learnt)


def _scored(job: _SweepJob) -> dict[str, _Score]:
    """One iteration of a family on one representation."""
    features = np.load(job.features, mmap_mode="r")
    fits = make_splits(job.design, job.plan.family, job.settings.seed, job.iteration)
    labels = {task.key: job.design.labels(task) for task in job.plan.tasks}
    answers = predict_splits(features, labels, fits, job.plan.k_max, job.settings.engine)
    scores = {}
    for task in job.plan.tasks:
        n_classes = len(job.design.classes(task))
        confusion = np.zeros((n_classes, n_classes), np.int64)
        correct, tested = np.zeros(job.plan.k_max, np.int64), 0
        for fit, found in zip(fits, answers, strict=True):
            if task.key not in found.predictions:
                continue
            truth = labels[task.key][fit.tests[task.key]]
            said = found.predictions[task.key]
            correct += (said == truth).sum(axis=1)
            tested += len(truth)
            np.add.at(confusion, (truth, said[min(published.K_MAX, len(said)) - 1]), 1)
        set_aside = max(found.without_variance for found in answers)
        beyond = max(found.beyond_rank for found in answers)
        scores[task.key] = _Score(correct, confusion, tested, set_aside, beyond)
    return scores


def _curve(representation: Representation, scores: Sequence[_Score]) -> Curve:
    return Curve(
        representation,
        np.array([score.correct / score.tested for score in scores]),
        np.sum([score.confusion for score in scores], axis=0),
        scores[0].tested,
        max(score.set_aside for score in scores),
        max(score.beyond_rank for score in scores),
    )


def _result(
    design: Design, plan: _Plan, task: published.Task, curves: Sequence[Curve]
) -> TaskResult:
    asked = curves[0].confusion.sum(axis=1)
    share = float(asked.max() / asked.sum())
    return TaskResult(task, design.classes(task), plan.k_max, plan.learnt, share, tuple(curves))
