"""A Poisson control: the same rates in every window, with the spikes of a Poisson process.

The encoder's neurons fire regularly. The control keeps the expected number of spikes of each train
in each window and draws the number from a Poisson distribution, so what it loses is what regular
firing carries beyond the rate.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.figure import Figure
from rigctl.analysis.splits import make_splits
from rigctl.analysis.study import (
    Case,
    Findings,
    Row,
    Study,
    bar_panel,
    cases,
    compared_row,
)
from rigctl.analysis.tasks import score_splits

STAGE = "classifying Poisson trains"
REGULAR, POISSON = "as encoded", "Poisson"
NOTE = (
    "Accuracy in %, mean ± standard deviation over the first draws of the report, from the "
    "encoder's spikes and from Poisson draws with the same expected number in every window, in "
    "training and test; p and d: Welch's test over draws."
)


class _Job(NamedTuple):
    case: Case
    seconds: NDArray[np.float64]


def measure(study: Study) -> Findings:
    """Return the accuracies from Poisson trains beside those of the report."""
    jobs = [_Job(case, _seconds(study, case.representation)) for case in cases(study)]
    shares: dict[tuple[str, str], list[float]] = defaultdict(list)
    for job, found in zip(jobs, study.resources.map(_score, jobs, STAGE), strict=True):
        for task, share in found.items():
            shares[task, job.case.representation].append(share)
    rows: list[Row] = []
    for result in study.results:
        k = min(one.shown_components for one in study.families[result.task.family])
        for one in study.shown:
            curve = result.curve(one.key)
            regular = [] if curve is None else curve.accuracy[: study.draws, k - 1].tolist()
            drawn = shares[result.task.key, one.key]
            rows += [
                compared_row(result, one.name, mine, regular, spikes=spikes)
                for spikes, mine in ((REGULAR, regular), (POISSON, drawn))
            ]
    panels = [bar_panel(result, rows, "spikes", study.shown) for result in study.results]
    figure = Figure("Accuracy of a Poisson control", panels, [NOTE])
    return Findings(_sentences(study, rows), rows, [figure], NOTE)


def poisson_features(
    features: NDArray[np.float64], seconds: NDArray[np.float64], random: np.random.Generator
) -> NDArray[np.float64]:
    """Return features of Poisson trains with the same expected spikes: float64 (n, width) both.

    ``seconds``: real time of each trial in each window, (n, n_windows); SA are rates, RA counts.
    """
    n_trials, n_windows = seconds.shape
    values = np.asarray(features).reshape(n_trials, -1, n_windows)
    n_sa = values.shape[1] // 2
    drawn = np.empty(values.shape)
    drawn[:, :n_sa] = random.poisson(values[:, :n_sa] * seconds[:, None])
    drawn[:, n_sa:] = random.poisson(values[:, n_sa:])
    sa = drawn[:, :n_sa]
    np.divide(sa, seconds[:, None], out=sa, where=seconds[:, None] > 0)
    return drawn.reshape(n_trials, -1)


def _seconds(study: Study, key: str) -> NDArray[np.float64]:
    found = study.representations
    layout = found.layout(next(one for one in found.present if one.key == key))
    trials = found.trials.trials
    each = [layout.window_durations_s(trial.n_samples, trial.speed_mm_s) for trial in trials]
    return np.array(each)


def _score(job: _Job) -> dict[str, float]:
    case = job.case
    random = np.random.default_rng([case.seed, case.draw, 7])
    features = poisson_features(case.load(), job.seconds, random)
    splits = make_splits(case.design, case.family, case.seed, case.draw)
    scores = score_splits(features, case.design, splits, case.tasks, case.k)
    return {key: float(one.correct[-1]) / one.n_tested for key, one in scores.items()}


def _sentences(study: Study, rows: Sequence[Row]) -> list[str]:
    task = study.results[0].task.title
    by = {(r["representation"], r["spikes"]): r["mean_percent"] for r in rows if r["task"] == task}
    parts = [
        f"{one.name} {by[one.name, REGULAR]:.1f} to {by[one.name, POISSON]:.1f}"
        for one in study.shown
    ]
    return [f"{task}, % as encoded and with Poisson spikes: {'; '.join(parts)}."]
