"""Accuracies from some of the trains: a receptor, a layer, a row, or taxels by number.

Each taxel has its own range, neurons and C, so a choice of trains is a choice of features.
"""

from __future__ import annotations

import re
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
    accuracy_row,
    bar_panel,
    cases,
)
from rigctl.analysis.tasks import score_splits
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import SensorLayout

STAGE = "classifying by some of the trains"
NOTE = (
    "Accuracy in % from the features of these trains alone, mean ± standard deviation over the "
    "first draws of the report, with the components of the report or as many as there are features."
)
WORD = re.compile(r"(SA|RA)|(layer) (\S+)|(row|column) (\d+)|(taxels?) ([\d,\s–-]+)", re.IGNORECASE)


class TrainChoice(NamedTuple):
    """Trains by their rows in :class:`rigctl.values.Spikes`: SA taxel 1 … n, RA taxel 1 … n."""

    name: str
    rows: tuple[int, ...]

    def columns(self, n_windows: int) -> NDArray[np.intp]:
        """Return the places of the trains' features in a vector."""
        starts = np.array(self.rows, np.intp)[:, None] * n_windows
        return (starts + np.arange(n_windows)).reshape(-1)


class _Job(NamedTuple):
    case: Case
    columns: NDArray[np.intp]


def usual_choices(layout: SensorLayout) -> list[TrainChoice]:
    """Return all trains, each receptor, each layer, both, and each row of taxels."""
    n = layout.n_taxels
    found = [TrainChoice("all trains", tuple(range(2 * n)))]
    found += [parse_choice(name, layout) for name in ("SA", "RA")]
    if len(layout.layers) > 1:
        found += [parse_choice(f"layer {name}", layout) for name in layout.layers]
        found += [TrainChoice(name, tuple(rows)) for name, rows in layout.train_groups()]
    if layout.rows > 1:
        found += [parse_choice(f"row {row + 1}", layout) for row in range(layout.rows)]
    return found


def parse_choice(text: str, layout: SensorLayout) -> TrainChoice:
    """Return the trains that a text names, such as ``SA layer I row 2`` or ``RA taxels 1-3, 7``.

    Each word narrows the choice. Raises WrongUse for other words and for what the sensor lacks.
    """
    n = layout.n_taxels
    taxels, receptors = set(range(n)), {0, 1}
    rest = WORD.sub("", text).strip()
    if rest or not text.strip():
        raise WrongUse(
            f"{text!r} names no trains: write SA or RA, layer NAME, row N, column N, taxels 1-3, 7"
        )
    for receptor, layer, name, line, number, many, listed in WORD.findall(text):
        if receptor:
            receptors &= {("SA", "RA").index(receptor.upper())}
        elif layer:
            taxels &= _layer(name, layout)
        elif line:
            taxels &= _line(line.lower(), int(number), layout)
        elif many:
            taxels &= _numbered(listed, layout)
    if not (taxels and receptors):
        raise WrongUse(f"{text!r} names no train: no taxel is in all of its parts")
    rows = tuple(sorted(one * n + taxel for one in receptors for taxel in taxels))
    return TrainChoice(text, rows)


def _layer(name: str, layout: SensorLayout) -> set[int]:
    if name not in layout.layers:
        raise WrongUse(f"there is no layer {name}: the sensor has {', '.join(layout.layers)}")
    return set(layout.taxels_of(layout.layers.index(name)))


def _line(kind: str, number: int, layout: SensorLayout) -> set[int]:
    """Return the taxels of a row or a column in every layer."""
    most = layout.rows if kind == "row" else layout.columns
    if not 1 <= number <= most:
        raise WrongUse(f"there is no {kind} {number}: the sensor has {most}")
    at = layout.row_of if kind == "row" else lambda taxel: taxel % layout.columns
    return {taxel for taxel in range(layout.n_taxels) if at(taxel) == number - 1}


def _numbered(listed: str, layout: SensorLayout) -> set[int]:
    """Return taxels from numbers and ranges, which count from 1 over all layers."""
    found: set[int] = set()
    for part in re.findall(r"(\d+)(?:\s*[–-]\s*(\d+))?", listed):
        first, last = int(part[0]), int(part[1] or part[0])
        if not 1 <= first <= last <= layout.n_taxels:
            outside = last if last > layout.n_taxels else first
            raise WrongUse(f"there is no taxel {outside}: choose 1 to {layout.n_taxels}")
        found |= set(range(first - 1, last))
    return found


def measure(study: Study) -> Findings:
    """Return the accuracies of each choice in each task and representation."""
    layout = study.representations.trials.sensor_layout
    choices, sentences = usual_choices(layout), []
    for text in study.constants.further.trains:
        try:
            choices.append(parse_choice(text, layout))
        except WrongUse as reason:
            sentences.append(f"further.trains: {reason}; left out.")
    windows = {
        one.key: study.representations.layout(one).n_windows
        for one in study.representations.present
    }
    jobs = [
        (choice.name, _Job(case, choice.columns(windows[case.representation])))
        for choice in choices
        for case in cases(study)
    ]
    scores = study.resources.map(_score, [job for _, job in jobs], STAGE)
    shares: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for (name, job), found in zip(jobs, scores, strict=True):
        for task, share in found.items():
            shares[task, job.case.representation, name].append(share)
    rows = _rows(study, choices, shares)
    return Findings([*sentences, *_sentences(study, rows)], rows, [_figure(study, rows)], NOTE)


def _score(job: _Job) -> dict[str, float]:
    case = job.case
    features = case.load()[:, job.columns]
    splits = make_splits(case.design, case.family, case.seed, case.draw)
    k = min(case.k, features.shape[1])
    scores = score_splits(features, case.design, splits, case.tasks, k)
    return {key: float(one.correct[-1]) / one.n_tested for key, one in scores.items()}


def _rows(
    study: Study,
    choices: Sequence[TrainChoice],
    shares: dict[tuple[str, str, str], list[float]],
) -> list[Row]:
    return [
        accuracy_row(
            result,
            one.name,
            shares[result.task.key, one.key, choice.name],
            trains=choice.name,
            number_of_trains=len(choice.rows),
        )
        for result in study.results
        for one in study.shown
        for choice in choices
    ]


def _sentences(study: Study, rows: Sequence[Row]) -> list[str]:
    """Return which receptor is better in the last of the representations, by task."""
    last = study.shown[-1].name
    by = {(r["task"], r["trains"]): r["mean_percent"] for r in rows if r["representation"] == last}
    parts = [
        f"{result.task.title.lower()} {by[result.task.title, 'SA']:.1f} and "
        f"{by[result.task.title, 'RA']:.1f} %"
        for result in study.results
    ]
    return [f"SA and RA trains alone, {last}: {'; '.join(parts)}."]


def _figure(study: Study, rows: Sequence[Row]) -> Figure:
    panels = [bar_panel(result, rows, "trains", study.shown) for result in study.results]
    return Figure("Accuracy from some of the trains", panels, [NOTE])
