"""What a further analysis gets, and what it returns to the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.cache import Resources
from rigctl.analysis.report.figure import Bars, Figure, Panel, Series
from rigctl.analysis.representations import (
    REPRESENTATIONS,
    Representation,
    RepresentationSet,
)
from rigctl.analysis.settings import AnalysisSettings
from rigctl.analysis.statistics import welch_each
from rigctl.analysis.tasks import SweepSettings, TaskResult
from rigctl.analysis.trial_set import Design

Step = TypeVar("Step", int, float)
DECIMALS = 4
COLOURS = {"original": "ink", "speed": "blue", "force": "red", "speed_force": "green"}
"""Representations of further analyses with their colours: those of the paper."""
Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Study:
    """A set that was encoded and classified.

    ``encode``: :func:`rigctl.analysis.representations.represent` for its trials; it still takes
    parameters, folder and resources, and other ranges. ``folder``: for files that are removed
    with the features.
    """

    encode: Callable[..., RepresentationSet]
    representations: RepresentationSet
    results: Sequence[TaskResult]
    settings: SweepSettings
    folder: Path
    resources: Resources

    @property
    def constants(self) -> AnalysisSettings:
        """The constants of the analysis file."""
        return self.representations.settings

    @property
    def design(self) -> Design:
        """Labels and conditions of the trials."""
        return Design.from_trials(self.representations.trials, self.constants)

    @property
    def draws(self) -> int:
        """The draws of the report that further analyses use: the first ones."""
        return min(self.settings.iterations, self.constants.further.draws)

    @property
    def shown(self) -> list[Representation]:
        """The paper's representations, as far as the trials allow them."""
        return [one for one in self.representations.present if one.key in COLOURS]

    @property
    def families(self) -> dict[str, list[TaskResult]]:
        """The results by family: tasks with the same splits."""
        found: dict[str, list[TaskResult]] = {}
        for result in self.results:
            found.setdefault(result.task.family, []).append(result)
        return found

    def result(self, task: str) -> TaskResult | None:
        """Return the results of a task, None where it was not run."""
        return next((one for one in self.results if one.task.key == task), None)

    def without_progress(self) -> Resources:
        """Return the workers and the cache; what runs inside a stage shows none of its own."""
        return replace(self.resources, progress=lambda stage, done, total: None)

    @contextmanager
    def part(self) -> Iterator[Path]:
        """Yield a folder for feature files, which is removed at the end."""
        with TemporaryDirectory(dir=self.folder) as name:
            yield Path(name)


class Findings(NamedTuple):
    """Results of a further analysis: sentences, rows with equal keys, figures, and what rows are.

    ``note`` stands below the table.
    """

    sentences: Sequence[str]
    rows: Sequence[Row]
    figures: Sequence[Figure] = ()
    note: str = ""


class Case(NamedTuple):
    """One draw of a family on one representation; ``k``: components at most."""

    representation: str
    features: Path
    design: Design
    family: str
    tasks: tuple[published.Task, ...]
    k: int
    seed: int
    draw: int

    def load(self) -> NDArray[np.float64]:
        """Return the features, mapped into memory: float64 (n_trials, width)."""
        features: NDArray[np.float64] = np.load(self.features, mmap_mode="r")
        return features


def cases(study: Study, files: Mapping[str, Path] | None = None) -> list[Case]:
    """Return the draws of every family and representation that further analyses use.

    ``files``: feature files by representation key, by default the study's.
    """
    files = files or study.representations.files
    design = study.design
    return [
        Case(
            one.key,
            files[one.key],
            design,
            family,
            tuple(result.task for result in results),
            min(result.shown_components for result in results),
            study.settings.seed,
            draw,
        )
        for family, results in study.families.items()
        for one in study.shown
        for draw in range(study.draws)
    ]


def accuracy_row(
    result: TaskResult, name: str, shares: Sequence[float], **columns: str | float
) -> Row:
    """Return a row of a representation: mean and standard deviation (n − 1) over draws, per cent.

    ``name``: of the representation; ``columns`` stand between it and the mean. The deviation of a
    single draw is None.
    """
    sd = percent(float(np.std(shares, ddof=1))) if len(shares) > 1 else None
    mean = percent(float(np.mean(shares)))
    known = {"task": result.task.title, "representation": name}
    return {**known, **columns, "mean_percent": mean, "sd_percent": sd}


def stepped_rows(
    study: Study,
    shares: Mapping[tuple[str, str, str, Step], Sequence[float]],
    classifiers: Sequence[str],
    steps: Sequence[Step],
    column: str,
) -> list[Row]:
    """Return a row for each task, representation, classifier and step of what is made worse.

    ``shares``: by task, representation (keys), classifier and step; ``column``: that of the step.
    """
    return [
        accuracy_row(
            result,
            one.name,
            shares[result.task.key, one.key, classifier, step],
            classifier=classifier,
            **{column: step},
        )
        for result in study.results
        for one in study.shown
        for classifier in classifiers
        for step in steps
    ]


def compared_row(
    result: TaskResult,
    name: str,
    shares: Sequence[float],
    others: Sequence[float],
    **columns: str | float,
) -> Row:
    """Return the row with Welch's test against the shares of ``others`` over the draws."""
    first, second = (np.array(one)[:, None] for one in (shares, others))
    (test,) = welch_each(first, second, result.thresholds.asterisks)
    compared = {"p": test.p, "d": test.effect, "stars": test.stars}
    return {**accuracy_row(result, name, shares, **columns), **compared}


def percent(share: float) -> float:
    """Return a share in per cent, as rows have it."""
    return round(100 * share, DECIMALS)


def curve_panel(
    result: TaskResult, rows: Sequence[Row], x: str, label: str, series: Mapping[str, Row]
) -> Panel:
    """Return a panel of a task's accuracies over the column ``x`` of some rows.

    ``series``: the rows of each curve by its name, as the values that they have; a representation
    says the colour, and a curve whose name begins otherwise is dashed.
    """
    title = f"{result.task.figure}  {result.task.title}".strip()
    mine = [row for row in rows if row["task"] == result.task.title]
    curves = []
    for name, chosen in series.items():
        own = [row for row in mine if chosen.items() <= row.items()]
        spread = [row["sd_percent"] for row in own]
        kind = next(one for one in REPRESENTATIONS if one.name == chosen["representation"])
        curves.append(
            Series(
                name,
                COLOURS[kind.key],
                [row[x] for row in own],
                [row["mean_percent"] for row in own],
                None if None in spread else spread,
                dashed=name != kind.name,
            )
        )
    last = max((row[x] for row in mine), default=1)
    level = (100 * result.chance, f"chance {100 * result.chance:.3g} %")
    ends = (0.0, 1.05 * last)
    return Panel(
        title, curves, label, "accuracy (%)", ends, (0.0, 100.0), x_name=label, level=level
    )


def bar_panel(
    result: TaskResult, rows: Sequence[Row], category: str, shown: Sequence[Representation]
) -> Bars:
    """Return bars of a task's accuracies for each value of a column, by representation."""
    mine = [row for row in rows if row["task"] == result.task.title]
    series = []
    for one in shown:
        own = [row for row in mine if row["representation"] == one.name]
        spread = [row["sd_percent"] for row in own]
        values = [row["mean_percent"] for row in own]
        bars = None if None in spread else spread
        series.append(Series(one.name, COLOURS[one.key], range(len(own)), values, bars))
    names = list(dict.fromkeys(row[category] for row in mine))
    title = f"{result.task.figure}  {result.task.title}".strip()
    return Bars(title, names, series, "accuracy (%)", (0.0, 100.0))
