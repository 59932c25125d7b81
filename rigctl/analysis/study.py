"""What a further analysis gets, and what it returns to the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from rigctl.analysis.cache import Resources
from rigctl.analysis.report.figure import Figure
from rigctl.analysis.representations import RepresentationSet
from rigctl.analysis.settings import AnalysisSettings
from rigctl.analysis.tasks import SweepSettings, TaskResult
from rigctl.analysis.trial_set import Design

DECIMALS = 4
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


def percent(share: float) -> float:
    """Return a share in per cent, as rows have it."""
    return round(100 * share, DECIMALS)
