"""Accuracies while taxels are lost one by one, with the old classifier and with a new one.

A lost taxel reads 0 and its neurons are silent. Which ones are lost is drawn anew in each draw.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.splits import make_splits
from rigctl.analysis.study import Case, Findings, Row, Study, cases, curve_panel, stepped_rows
from rigctl.analysis.tasks import score_splits
from rigctl.errors import WrongUse

STAGE = "losing taxels"
STEPS = (0, 1, 2, 3, 4, 6, 8, 10, 12, 15, 17, 24, 32, 48, 64, 96, 128)
OLD, NEW = "trained before the loss", "trained after the loss"
NOTE = (
    "Accuracy in %, mean ± standard deviation over the first draws of the report; each draw loses "
    "taxels in an order of its own, the same for all representations. A lost taxel reads 0. Lines: "
    "the classifier was trained before the loss; dashed: it was trained anew without the taxels."
)


class _Job(NamedTuple):
    case: Case
    n_taxels: int
    lost: tuple[int, ...]


def measure(study: Study) -> Findings:
    """Return the accuracies after each loss. Raises WrongUse for a sensor of one taxel."""
    n = study.representations.trials.n_taxels
    lost = tuple(step for step in STEPS if step < n)
    if len(lost) < 2:
        raise WrongUse("it needs a sensor of two taxels or more")
    jobs = [_Job(case, n, lost) for case in cases(study)]
    shares: dict[tuple[str, str, str, int], list[float]] = defaultdict(list)
    for job, found in zip(jobs, study.resources.map(_score, jobs, STAGE), strict=True):
        for (task, trained, number), share in found.items():
            shares[task, job.case.representation, trained, number].append(share)
    rows = stepped_rows(study, shares, (OLD, NEW), lost, "taxels_lost")
    return Findings(_sentences(study, rows), rows, [_figure(study, rows)], NOTE)


def columns_of(taxels: Sequence[int], n_taxels: int, width: int) -> NDArray[np.intp]:
    """Return the places of some taxels' features, SA and RA, in a vector of ``width``."""
    train = np.arange(width).reshape(2 * n_taxels, -1)
    kept = np.isin(np.arange(2 * n_taxels) % n_taxels, taxels)
    return train[kept].reshape(-1)


def _score(job: _Job) -> dict[tuple[str, str, int], float]:
    """Return the share of right answers by task, classifier and number of taxels lost."""
    case, n = job.case, job.n_taxels
    features = case.load()
    splits = make_splits(case.design, case.family, case.seed, case.draw)
    order = np.random.default_rng([case.seed, case.draw]).permutation(n)
    labels = {task.key: case.design.labels(task) for task in case.tasks}
    right: dict[tuple[str, str, int], int] = defaultdict(int)
    tested: dict[str, int] = defaultdict(int)
    for split in splits:
        for key, rows in split.tests.items():
            tested[key] += len(rows) if key in labels else 0
        for (key, number), n_right in _with_old(features, split, labels, order, job).items():
            right[key, OLD, number] += n_right
    for number in job.lost:
        kept = features[:, columns_of(order[number:].tolist(), n, features.shape[1])]
        k = min(case.k, kept.shape[1])
        for key, one in score_splits(kept, case.design, splits, case.tasks, k).items():
            right[key, NEW, number] = int(one.correct[-1])
    return {key: n_right / tested[key[0]] for key, n_right in right.items()}


def _with_old(
    features: NDArray[np.float64],
    split: Split,
    labels: dict[str, NDArray[np.int64]],
    order: NDArray[np.int64],
    job: _Job,
) -> dict[tuple[str, int], int]:
    """Return the right answers of one classifier to trials whose taxels fall silent."""
    tests = {key: rows for key, rows in split.tests.items() if key in labels}
    parts, at = [features[split.train]], len(split.train)
    moved: dict[str, NDArray[np.intp]] = {}
    names = {}
    for key, rows in tests.items():
        for number in job.lost:
            silent = features[rows].copy()
            silent[:, columns_of(order[:number].tolist(), job.n_taxels, features.shape[1])] = 0.0
            parts.append(silent)
            moved[f"{key} {number}"] = at + np.arange(len(rows))
            names[f"{key} {number}"] = (key, number, labels[key][rows])
            at += len(rows)
    joined, train = np.concatenate(parts), np.arange(len(split.train))
    truth = {
        name: np.concatenate([labels[key][split.train], np.zeros(at - len(train), np.int64)])
        for name, (key, _, _) in names.items()
    }
    (found,) = predict_splits(joined, truth, [Split(train, moved)], job.case.k, SweepEngine.OWN)
    return {
        (key, number): int((found.predictions[name][-1] == answers).sum())
        for name, (key, number, answers) in names.items()
    }


def _sentences(study: Study, rows: Sequence[Row]) -> list[str]:
    by = {
        (r["task"], r["representation"], r["classifier"], r["taxels_lost"]): r["mean_percent"]
        for r in rows
    }
    task, name = study.results[0].task.title, study.shown[-1].name
    return [
        f"{task}, {name}: one lost taxel of {study.representations.trials.n_taxels} leaves "
        f"{by[task, name, OLD, 1]:.1f} of {by[task, name, OLD, 0]:.1f} %, and "
        f"{by[task, name, NEW, 1]:.1f} % with a classifier that was trained after the loss."
    ]


def _figure(study: Study, rows: Sequence[Row]) -> Figure:
    series = {
        f"{one.name}{ending}": {"representation": one.name, "classifier": trained}
        for one in study.shown
        for trained, ending in ((OLD, ""), (NEW, ", trained anew"))
    }
    panels = [
        curve_panel(result, rows, "taxels_lost", "taxels lost", series) for result in study.results
    ]
    return Figure("Accuracy while taxels are lost", panels, [NOTE])
