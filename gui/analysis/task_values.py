"""What the window and its worker processes exchange. This module does not import Qt."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format.sensor_layout import SensorLayout

if TYPE_CHECKING:
    from rigctl.analysis.settings.analysis_settings import AnalysisSettings

PLAN_ROWS = ("Trials", "Plate changes", "Duration", "Disk space")
DRUM, FINGER = "drum", "finger"
"""Experiments of a session."""


class SessionTable(NamedTuple):
    """A session's trials as text, a sentence about the session, its experiment, and its digest."""

    path: str = ""
    about: str = ""
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    experiment: str = DRUM
    closing_digest: str = ""


class TrialData(NamedTuple):
    """Readings and spikes of one trial.

    ``samples``: uint16 (n, n_taxels). ``spike_row`` and ``spike_sample``: int64 (k,), one entry per
    spike; rows are SA taxel 1 … n, then RA 1 … n.
    """

    title: str
    samples: NDArray[np.uint16]
    spike_row: NDArray[np.int64]
    spike_sample: NDArray[np.int64]
    layout: SensorLayout


class ScanPicture(NamedTuple):
    """The path of the picture of one scan of the moving finger."""

    figure: str


class QuickCheckResult(NamedTuple):
    """The accuracy in a sentence, and the path of its figure."""

    sentence: str
    figure: str


class FingerSessionInfo(NamedTuple):
    """A session of the moving finger: its stages, its simulated person, and the slides so far."""

    path: str
    stages: tuple[str, ...]
    seed: int
    session: int
    slides: int


class AnalysisRequest(NamedTuple):
    """The options of ``rigctl analyse``.

    ``task``: empty for all. ``representation``: that of a model to save beside the report, empty
    for none. ``c``: a model file that C is taken from, empty for a search. ``settings``: an
    analysis file, empty for the paper's constants; with one, its reference force holds.
    """

    sessions: tuple[str, ...]
    folder: str
    task: str
    draws: int
    components: int
    engine: str
    preset: str
    reference_g: float
    seed: int
    sensitivity: bool
    representation: str
    c: str
    settings: str


def analysis_settings(request: AnalysisRequest) -> AnalysisSettings:
    """Return the constants of the request's analysis file, or the paper's."""
    from rigctl.analysis.settings.analysis_settings import AnalysisSettings
    from rigctl.analysis.settings.settings_file import load_settings

    if request.settings:
        return load_settings(Path(request.settings).expanduser())
    return AnalysisSettings().with_reference_force(request.reference_g)


def model_path(report: Path) -> Path:
    """Return the path of a report's model: beside its folder."""
    return report.with_name(f"{report.name}-model.h5")


class PlanSummary(NamedTuple):
    """The plan of a protocol: a text for each of ``PLAN_ROWS``, and the seed of its order.

    ``problem`` says why the protocol cannot run; it is empty if it can.
    """

    texts: tuple[str, ...] = ("–",) * len(PLAN_ROWS)
    seed: int = 0
    problem: str = ""
