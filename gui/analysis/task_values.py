"""What the window and its worker processes exchange. This module does not import Qt."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.analysis.trial_table import AttemptColumn
from gui.analysis.value_file import data_words
from gui.widgets.typed_paths import new_files_folder, typed_path
from rigctl.session.notes import Mark
from rigctl.session.sensor_layout import SensorLayout
from rigctl.synth.sample_session import sample_folder
from rigctl.values import SessionLine, TrialMark, Verdict

if TYPE_CHECKING:
    from rigctl.analysis.options import AnalysisOptions
    from rigctl.analysis.session_quality import QualityPicture


MARKED_BAD = "marked bad"
"""Part of the reason for a trial that a note leaves out."""
DRUM, FINGER = "drum", "finger"
"""Experiments of a session."""


class SessionTable(NamedTuple):
    """A session's trials, a sentence about the session, its experiment, and its digest.

    ``missing``: what cannot be read of it, as sentences without the last full stop; empty if it is
    whole. ``closing_digest``: empty for a session that is not closed or lacks its end. ``reasons``:
    row and sentence of each attempt that does not count. ``is_growing``: its writer may be alive.
    ``first_shown``: row of the attempt that is shown first.
    """

    path: str = ""
    about: str = ""
    columns: tuple[AttemptColumn, ...] = ()
    experiment: str = DRUM
    closing_digest: str = ""
    missing: str = ""
    reasons: tuple[tuple[int, str], ...] = ()
    is_growing: bool = False
    first_shown: int = 0

    @property
    def n_rows(self) -> int:
        """Number of attempts."""
        return len(self.columns[0].values) if self.columns else 0

    def possible_mark(self, row: int) -> Mark:
        """Return what a person can mark an attempt: bad, good where it is marked bad, or nothing.

        Other attempts than committed ones do not count in any case.
        """
        verdicts = [column.text(row) for column in self.columns if column.name == "Verdict"]
        if verdicts == [Verdict.COMMITTED]:
            return Mark.BAD
        return Mark.GOOD if MARKED_BAD in dict(self.reasons).get(row, "") else Mark.NONE


class TrialCourse(NamedTuple):
    """Force and speed around a trial; times in seconds since its first sample, NaN if unknown.

    ``force_s``, ``force_g``: float64 (n,), the load cell's. ``speed_s``, ``speed_mm_s``:
    float64 (m,), the drum's polls. ``planned_g``, ``planned_mm_s``: what the protocol asked for.
    """

    force_s: NDArray[np.float64]
    force_g: NDArray[np.float64]
    speed_s: NDArray[np.float64]
    speed_mm_s: NDArray[np.float64]
    planned_g: float
    planned_mm_s: float


class TrialFeatures(NamedTuple):
    """Features of a trial: ``values`` float64 (trains, windows), SA in Hz, RA as counts.

    ``window_mm``: texture that passes in a window, 0 for windows of ``window_ms`` of time.
    """

    values: NDArray[np.float64]
    window_mm: float
    window_ms: int


class Section(NamedTuple):
    """A part of a trial from the sample ``first`` on, in k groups of ``factor`` samples.

    ``low``, ``high``: uint16 (k, n_taxels), the lowest and highest readings of each group; of
    single samples both are the readings. ``spikes``: uint8 (k, 2 * n_taxels), whether a spike
    fell into it; rows are SA taxel 1 … n, then RA 1 … n. ``course``: of this time.
    """

    first: int
    factor: int
    low: NDArray[np.uint16]
    high: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    course: TrialCourse | None = None

    @property
    def end(self) -> int:
        """The sample after the last one, or after its group."""
        return self.first + len(self.low) * self.factor


class TrialData(NamedTuple):
    """Readings and spikes of one trial, and what the drum did.

    ``overview``: all of the trial, of a long one in groups of samples. ``place``: path of the
    session and row of the attempt, of which finer sections can be read. ``marks``: what people
    noted on it.
    """

    title: str
    overview: Section
    layout: SensorLayout
    course: TrialCourse | None = None
    features: TrialFeatures | None = None
    simulated: bool = False
    n_samples: int = 0
    place: tuple[str, int] = ("", 0)
    marks: tuple[TrialMark, ...] = ()

    @property
    def heading(self) -> str:
        """The title, which says so where the data are simulated."""
        origin = f"{data_words(simulated=True)} · " if self.simulated else ""
        return f"{origin}{self.title}"

    @property
    def is_long(self) -> bool:
        """Whether single samples are read only where they are looked at."""
        return self.overview.factor > 1


class NeuronVoltage(NamedTuple):
    """The membrane voltage of SA and RA of a taxel from a sample on, float64 (n, 2) in mV."""

    taxel: int
    first: int
    voltage_mv: NDArray[np.float64]


class ScanPicture(NamedTuple):
    """The path of the picture of one scan of the moving finger."""

    figure: str


class FingerSessionInfo(NamedTuple):
    """A session of the moving finger: its stages, its simulated person, and the slides so far."""

    path: str
    stages: tuple[str, ...]
    seed: int
    session: int
    slides: int


ENGINE_NAMES = {"own": "rigctl's own", "sklearn": "scikit-learn"}
"""What people read for the engine of an analysis."""


def describe_options(options: AnalysisOptions, experiment: str) -> str:
    """Return the settings of an analysis in a sentence."""
    names = ", ".join(path.name for path in options.sessions)
    parts = [f"Sessions: {names}", f"draws: {options.iterations}", f"seed: {options.seed}"]
    if experiment == DRUM:
        constants = options.settings.name if options.settings else "the paper's"
        parts += [
            f"tasks: {', '.join(options.task) or 'all that fit'}",
            f"components: up to {options.k_max}",
            f"encoder: {options.preset}",
            f"constants: {constants}",
            f"C: {options.c.name if options.c else 'by a search'}",
        ]
        if not options.settings:
            parts.append(f"reference force: {options.analysis.conditions.reference_force_g:g} g")
    return "; ".join([*parts, f"engine: {ENGINE_NAMES.get(options.engine, options.engine)}"])


def results_folder(session: str, chosen: str, fallback: str) -> Path:
    """Return the folder for figures, reports and models of a session.

    It is the chosen one, else that of the session. An archive that nobody can write into and the
    hidden folder of the sample session have theirs in ``fallback``. Raises WrongUse for a folder
    that is no whole path.
    """
    if chosen.strip():
        return new_files_folder(chosen)
    beside = typed_path(session).absolute().parent
    is_hidden = beside == sample_folder().parent
    return new_files_folder(fallback) if is_hidden or not os.access(beside, os.W_OK) else beside


def figures_folder(place: Path, session: str) -> str:
    """Return the folder of a session's saved pages and figures."""
    return str(place / f"{typed_path(session).name}-figures")


def model_path(report: Path) -> Path:
    """Return the path of a report's model: beside its folder."""
    return report.with_name(f"{report.name}-model.h5")


class JudgedTrials(NamedTuple):
    """The quality of a session's trials: attempts by verdict, and how many are to be judged yet.

    ``commonest``: the commonest reason, empty without any.
    """

    path: str
    simulated: bool
    picture: QualityPicture
    counts: dict[str, int]
    commonest: str
    left: int


class FoundSessions(NamedTuple):
    """The paths of the sessions below a folder, the newest first."""

    paths: tuple[str, ...]


class SessionLines(NamedTuple):
    """What a list says of some sessions."""

    lines: tuple[SessionLine, ...]
