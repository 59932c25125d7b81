"""Other classifiers beside LDA, on the same components of the same folds: scikit-learn's."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.pca_lda import count_real_components, fit_pca
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
from rigctl.analysis.tasks import TaskResult

STAGE = "other classifiers"
LDA = "LDA"
CLUSTERS = "k-means clusters"
NOTE = (
    "Accuracy in %, mean ± standard deviation over the first draws of the report. Each classifier "
    "gets the principal components that LDA gets, from the same training trials, scaled to unit "
    "variance. k-means sees no label: it finds as many clusters as there are classes in the "
    "training trials, each cluster is named by the majority of its training trials, and a tested "
    "trial gets the name of the nearest cluster. p and d: Welch's test against LDA over draws."
)


class _Job(NamedTuple):
    case: Case
    neighbours: int


class _Scores(NamedTuple):
    """Right answers by task and classifier, trials by task, and fits that did not converge."""

    right: dict[tuple[str, str], int]
    tested: dict[str, int]
    unconverged: int


def measure(study: Study) -> Findings:
    """Return the accuracies of each classifier in each task and representation."""
    jobs = [_Job(case, study.constants.further.neighbours) for case in cases(study)]
    shares: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    unconverged = 0
    for job, found in zip(jobs, study.resources.map(_score, jobs, STAGE), strict=True):
        unconverged += found.unconverged
        for (task, name), right in found.right.items():
            shares[task, job.case.representation, name].append(right / found.tested[task])
    names = list(dict.fromkeys(name for _, _, name in shares))
    rows: list[Row] = []
    for result in study.results:
        for one in study.shown:
            lda = _lda(result, one.key, study.draws, min(job.case.k for job in jobs
                       if job.case.family == result.task.family))  # fmt: skip
            rows.append(compared_row(result, one.name, lda, lda, classifier=LDA))
            for name in names:
                mine = shares[result.task.key, one.key, name]
                rows.append(compared_row(result, one.name, mine, lda, classifier=name))
    sentences = _sentences(study, rows, names)
    if unconverged:
        sentences.append(f"{unconverged} fits of these classifiers did not converge.")
    return Findings(sentences, rows, [_figure(study, rows)], NOTE)


def _lda(result: TaskResult, key: str, draws: int, k: int) -> list[float]:
    curve = result.curve(key)
    return [] if curve is None else curve.accuracy[:draws, k - 1].tolist()


def classifiers(neighbours: int) -> dict[str, Callable[[], Any]]:
    """Return makers of scikit-learn's classifiers by name."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.svm import LinearSVC

    return {
        f"{neighbours} nearest neighbours": lambda: KNeighborsClassifier(neighbours),
        "linear SVM": lambda: LinearSVC(dual="auto", max_iter=20_000, random_state=0),
        "logistic regression": lambda: LogisticRegression(max_iter=5_000),
    }


def _score(job: _Job) -> _Scores:
    from sklearn.exceptions import ConvergenceWarning

    case, features = job.case, job.case.load()
    labels = {task.key: case.design.labels(task) for task in case.tasks}
    right: dict[tuple[str, str], int] = defaultdict(int)
    tested: dict[str, int] = defaultdict(int)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ConvergenceWarning)
        for split in make_splits(case.design, case.family, case.seed, case.draw):
            pca = fit_pca(np.asarray(features[split.train]), case.k)
            k = count_real_components(pca)
            scale = np.sqrt(pca.variance[:k])
            for key, rows in split.tests.items():
                if key not in labels:
                    continue
                known = split.train[labels[key][split.train] >= 0]
                train, test = (pca.transform(features[one])[:, :k] / scale for one in (known, rows))
                answers = _answers(train, labels[key][known], test, job)
                for name, predicted in answers.items():
                    right[key, name] += int((predicted == labels[key][rows]).sum())
                tested[key] += len(rows)
    slow = sum(issubclass(one.category, ConvergenceWarning) for one in caught)
    return _Scores(dict(right), dict(tested), slow)


def _answers(
    train: NDArray[np.float64],
    truth: NDArray[np.int64],
    test: NDArray[np.float64],
    job: _Job,
) -> dict[str, NDArray[np.int64]]:
    """Return the predictions of every classifier."""
    from sklearn.cluster import KMeans

    found = {}
    for name, make in classifiers(min(job.neighbours, len(train))).items():
        found[name] = make().fit(train, truth).predict(test)
    means = KMeans(len(np.unique(truth)), n_init=10, random_state=job.case.draw).fit(train)
    counts = np.zeros((means.n_clusters, truth.max() + 1), np.int64)
    np.add.at(counts, (means.labels_, truth), 1)
    found[CLUSTERS] = counts.argmax(axis=1)[means.predict(test)]
    return found


def _sentences(study: Study, rows: Sequence[Row], names: Sequence[str]) -> list[str]:
    task = study.results[0].task.title
    last = study.shown[-1].name
    by = {r["classifier"]: r["mean_percent"] for r in rows
          if (r["task"], r["representation"]) == (task, last)}  # fmt: skip
    listed = ", ".join(f"{name} {by[name]:.1f} %" for name in (LDA, *names))
    return [f"{task}, {last}: {listed}."]


def _figure(study: Study, rows: Sequence[Row]) -> Figure:
    panels = [bar_panel(result, rows, "classifier", study.shown) for result in study.results]
    return Figure("Accuracy of other classifiers", panels, [NOTE])
