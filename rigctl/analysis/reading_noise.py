"""Accuracies with noise added to the readings, for classifiers trained without and with it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rigctl.analysis.cache import Cache
from rigctl.analysis.force_scaling import ForceMatrixSource
from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.splits import make_splits
from rigctl.analysis.study import Case, Findings, Row, Study, cases, curve_panel, stepped_rows

STAGE = "encoding with noise"
CLEAN, NOISY = "trained without the noise", "trained with it"
NOTE = (
    "Accuracy in %, mean ± standard deviation over the first draws of the report, with normal "
    "noise of this standard deviation on every reading, which is a whole count again. Taxel ranges "
    "and C are those without noise. Lines: trained without the noise; dashed: trained with it."
)


class _Job(NamedTuple):
    case: Case
    noisy: Path


def measure(study: Study) -> Findings:
    """Return the accuracies at each deviation of the noise."""
    shares: dict[tuple[str, str, str, float], list[float]] = defaultdict(list)
    levels = (0.0, *sorted(study.constants.further.noise_counts))
    for number, counts in enumerate(levels):
        study.resources.progress(STAGE, number, len(levels))
        with study.part() as folder:
            files = study.representations.files
            if counts:
                files = _encode(study, counts, folder).files
            jobs = [_Job(case, files[case.representation]) for case in cases(study)]
            scores = study.without_progress().map(_score, jobs, STAGE)
            for job, found in zip(jobs, scores, strict=True):
                for (task, trained), share in found.items():
                    shares[task, job.case.representation, trained, counts].append(share)
    study.resources.progress(STAGE, len(levels), len(levels))
    rows = stepped_rows(study, shares, (CLEAN, NOISY), levels, "noise_counts")
    return Findings(_sentences(study, rows, levels[-1]), rows, [_figure(study, rows)], NOTE)


def _encode(study: Study, counts: float, folder: Path) -> RepresentationSet:
    """Return the representations of the same trials with noise, by the same ranges and C."""
    clean = study.representations
    noisy = tuple(replace(file, noise_counts=counts) for file in clean.trials.files)
    trials = replace(clean.trials, files=noisy)
    source = None if clean.force is None else ForceMatrixSource(Path("the report"), clean.force, ())
    # The cache knows trials by their recorded bytes.
    resources = replace(study.without_progress(), cache=Cache())
    return represent(
        trials,
        clean.parameters,
        folder,
        settings=clean.settings,
        source=source,
        ranges=clean.normalisation,
        resources=resources,
    )


def _score(job: _Job) -> dict[tuple[str, str], float]:
    """Return the share of right answers to noisy trials by task and classifier."""
    case, clean, noisy = job.case, job.case.load(), np.load(job.noisy, mmap_mode="r")
    right: dict[tuple[str, str], int] = defaultdict(int)
    tested: dict[str, int] = defaultdict(int)
    labels = {task.key: case.design.labels(task) for task in case.tasks}
    for split in make_splits(case.design, case.family, case.seed, case.draw):
        tests = {key: rows for key, rows in split.tests.items() if key in labels}
        n, order = len(split.train), np.concatenate([split.train, *tests.values()])
        ends = n + np.cumsum([0, *map(len, tests.values())])
        places = {key: np.arange(*ends[i : i + 2]) for i, key in enumerate(tests)}
        local = Split(np.arange(n), places)
        truth = {key: values[order] for key, values in labels.items() if key in tests}
        for trained, features in ((CLEAN, clean), (NOISY, noisy)):
            joined = np.concatenate([features[split.train], noisy[order[n:]]])
            (found,) = predict_splits(joined, truth, [local], case.k, SweepEngine.OWN)
            for key, rows in tests.items():
                predicted = found.predictions[key][-1]
                right[key, trained] += int((predicted == labels[key][rows]).sum())
        for key, rows in tests.items():
            tested[key] += len(rows)
    return {key: n_right / tested[key[0]] for key, n_right in right.items()}


def _sentences(study: Study, rows: Sequence[Row], most: float) -> list[str]:
    by = {
        (r["task"], r["representation"], r["classifier"], r["noise_counts"]): r["mean_percent"]
        for r in rows
    }
    task = study.results[0].task.title
    parts = [
        f"{one.name} {by[task, one.name, CLEAN, 0.0]:.1f} to {by[task, one.name, CLEAN, most]:.1f} "
        f"({by[task, one.name, NOISY, most]:.1f} if trained with it)"
        for one in study.shown
    ]
    return [f"{task}, % without noise and with {most:g} counts: {'; '.join(parts)}."]


def _figure(study: Study, rows: Sequence[Row]) -> Figure:
    series = {
        f"{one.name}{ending}": {"representation": one.name, "classifier": trained}
        for one in study.shown
        for trained, ending in ((CLEAN, ""), (NOISY, ", trained with it"))
    }
    panels = [
        curve_panel(result, rows, "noise_counts", "noise (counts)", series)
        for result in study.results
    ]
    return Figure("Accuracy with noise on the readings", panels, [NOTE])
