"""What a further analysis gets, and what it returns to the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.cache import Resources
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.representations import Representation, RepresentationSet
from rigctl.analysis.settings import AnalysisSettings
from rigctl.analysis.tasks import SweepSettings, TaskResult
from rigctl.analysis.trial_set import Design

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


def mean_and_sd(shares: Sequence[float]) -> tuple[float, float | None]:
    """Return mean and standard deviation (n − 1) over draws, in per cent; None for one draw."""
    sd = float(np.std(shares, ddof=1)) if len(shares) > 1 else None
    return percent(float(np.mean(shares))), None if sd is None else percent(sd)


def percent(share: float) -> float:
    """Return a share in per cent, as rows have it."""
    return round(100 * share, DECIMALS)
