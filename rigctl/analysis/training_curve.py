"""Accuracies over the number of training trials, for each representation, on the same tests."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.splits import make_splits
from rigctl.analysis.study import (
    Case,
    Findings,
    Row,
    Study,
    accuracy_row,
    cases,
    curve_panel,
)
from rigctl.analysis.tasks import TaskResult
from rigctl.errors import WrongUse

STAGE = "training with fewer trials"
SHARES = (0.03, 0.06, 0.12, 0.25, 0.5, 0.75, 1.0)
NOTE = (
    "Accuracy in %, mean ± standard deviation over the first draws of the report. Each point "
    "trains with a random part of a fit's training trials, the same for all representations and as "
    "evenly of each texture as it can be, and tests the same trials; components as in the report, "
    "or half of what the trials allow."
)


class _Point(NamedTuple):
    trained: int
    share: float


def measure(study: Study) -> Findings:
    """Return the curve of each task. Raises WrongUse where no smaller training set can be made."""
    jobs = cases(study)
    points: dict[tuple[str, str, float], list[_Point]] = defaultdict(list)
    for case, found in zip(jobs, study.resources.map(_score, jobs, STAGE), strict=True):
        for (task, size), point in found.items():
            points[task, case.representation, size].append(point)
    rows = [
        _row(result, one.name, points[result.task.key, one.key, size])
        for result in study.results
        for one in study.shown
        for size in SHARES
        if len(points[result.task.key, one.key, size]) == study.draws
    ]
    if not rows:
        raise WrongUse("the training trials are too few to train with fewer")
    return Findings(_sentences(study, rows), rows, [_figure(study, rows)], NOTE)


def part_of(
    train: np.ndarray, texture: np.ndarray, share: float, seed: Sequence[int]
) -> np.ndarray:
    """Return a random share of training rows, the first ones of an order that mixes textures."""
    random = np.random.default_rng(seed)
    shuffled = random.permutation(train)
    # The first trial of each texture, then the second of each, and so on.
    order = np.empty(len(shuffled), np.int64)
    for label in np.unique(texture[shuffled]):
        mine = texture[shuffled] == label
        order[mine] = np.arange(mine.sum())
    return shuffled[np.argsort(order, kind="stable")][: round(share * len(train))]


def _score(case: Case) -> dict[tuple[str, float], _Point]:
    features, texture = case.load(), case.design.texture
    labels = {task.key: case.design.labels(task) for task in case.tasks}
    splits = make_splits(case.design, case.family, case.seed, case.draw)
    points: dict[tuple[str, float], _Point] = {}
    for share in SHARES:
        small = [
            Split(part_of(one.train, texture, share, [case.seed, case.draw, number]), one.tests)
            for number, one in enumerate(splits)
        ]
        n = min(len(one.train) for one in small)
        room = n - max(len(np.unique(texture[one.train])) for one in small)
        k = case.k if share == 1 else min(case.k, room // 2, features.shape[1])
        if k < 1:
            continue
        fits = predict_splits(features, labels, small, k, SweepEngine.OWN)
        for key, truth in labels.items():
            right = tested = 0
            for fit, one in zip(fits, small, strict=True):
                if key in fit.predictions:
                    right += int((fit.predictions[key][-1] == truth[one.tests[key]]).sum())
                    tested += len(one.tests[key])
            points[key, share] = _Point(n, right / tested)
    return points


def _row(result: TaskResult, name: str, points: Sequence[_Point]) -> Row:
    trained = round(float(np.mean([one.trained for one in points])))
    return accuracy_row(result, name, [one.share for one in points], training_trials=trained)


def _sentences(study: Study, rows: Sequence[Row]) -> list[str]:
    task = study.results[0].task.title
    parts = []
    for one in study.shown:
        mine = [r for r in rows if (r["task"], r["representation"]) == (task, one.name)]
        last = mine[-1]
        near = next(r for r in mine if r["mean_percent"] >= 0.9 * last["mean_percent"])
        parts.append(f"{one.name} {near['training_trials']:,} of {last['training_trials']:,}")
    return [f"{task}: nine tenths of the accuracy need training trials: {', '.join(parts)}."]


def _figure(study: Study, rows: Sequence[Row]) -> Figure:
    series = {one.name: {"representation": one.name} for one in study.shown}
    panels = [
        curve_panel(result, rows, "training_trials", "training trials", series)
        for result in study.results
    ]
    return Figure("Accuracy over training trials", panels, [NOTE])
