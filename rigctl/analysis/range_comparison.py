"""Accuracies of the extrapolation with taxel ranges over all trials, and over the trained ones.

Ranges over all trials know the readings of conditions that the classifier does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigctl.analysis.further_tasks import EXTRAPOLATION
from rigctl.analysis.representations import RepresentationSet
from rigctl.analysis.spike_counts import RangesOver
from rigctl.analysis.statistics import welch_each
from rigctl.analysis.study import Findings, Row, Study, percent
from rigctl.analysis.tasks import TaskResult, run_tasks
from rigctl.errors import WrongUse

STAGE = "encoding with other taxel ranges"
NOTE = (
    "Accuracy in %, mean over the same draws, with taxel ranges over all trials as in the paper, "
    "and over the trials at the trained speeds and forces (--ranges training). Welch's p over "
    "draws of the same trials."
)


def measure(study: Study) -> Findings:
    """Return both accuracies of each representation in the tasks of the extrapolation.

    Raises WrongUse where it was not run.
    """
    mine = [one for one in study.results if one.task.family == EXTRAPOLATION]
    if not mine:
        raise WrongUse("it needs the extrapolation, which was not run")
    both: dict[RangesOver, Sequence[TaskResult]] = {}
    for number, over in enumerate(RangesOver):
        study.resources.progress(STAGE, number, len(RangesOver))
        both[over] = _results(study, over)
    study.resources.progress(STAGE, len(RangesOver), len(RangesOver))
    rows = [row for pair in zip(*both.values(), strict=True) for row in _rows(*pair)]
    widest = max(rows, key=lambda row: abs(row["points"]))
    sentence = (
        f"Ranges over the training trials alone change an accuracy of the extrapolation by "
        f"{sum(abs(row['points']) for row in rows) / len(rows):.1f} points on average, at most by "
        f"{abs(widest['points']):.1f} ({widest['representation']}, {widest['task'].lower()}: "
        f"{widest['all_percent']:.1f} to {widest['training_percent']:.1f} %)."
    )
    return Findings((sentence,), rows, note=NOTE)


def _results(study: Study, over: RangesOver) -> Sequence[TaskResult]:
    settings = replace(study.settings, tasks=(EXTRAPOLATION,))
    with study.part() as folder:
        parameters, resources = study.representations.parameters, study.without_progress()
        found: RepresentationSet = study.encode(
            parameters, folder, resources=resources, ranges=over
        )
        return run_tasks(found, settings, resources)[0]


def _rows(over_all: TaskResult, over_training: TaskResult) -> list[Row]:
    rows: list[Row] = []
    for curve in over_all.curves:
        other = over_training.curve(curve.representation.key)
        if other is None:
            continue
        k = over_all.shown_components - 1
        first, second = float(curve.mean[k]), float(other.mean[k])
        shown = slice(k, k + 1)
        (test,) = welch_each(other.accuracy[:, shown], curve.accuracy[:, shown])
        rows.append(
            {
                "task": over_all.task.title,
                "representation": curve.representation.name,
                "components": k + 1,
                "all_percent": percent(first),
                "training_percent": percent(second),
                "points": percent(second - first),
                "p": test.p,
            }
        )
    return rows
