"""The demo's analysis of a session: encode, classify held-out trials, draw two figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.analysis.classification.held_out import (
    HeldOutPredictions,
    LabelledTrials,
    Progress,
    classify_held_out,
)
from rigctl.analysis.paper.statistics import wilson_interval
from rigctl.analysis.report.figures import RasterData, draw_accuracy, draw_raster
from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.errors import SessionError, WrongUse
from rigctl.session.read.session import Session


@dataclass(frozen=True, slots=True)
class DemoResult:
    """A summary sentence, the figures, the predictions, and remarks."""

    sentence: str
    raster: Path
    accuracy: Path
    held_out: HeldOutPredictions
    remarks: tuple[str, ...]


def analyse_session(
    path: Path, figures: Path, *, progress: Progress = lambda stage, share: None
) -> DemoResult:
    """Classify a session's textures and draw the figures into the folder ``figures``.

    Raises SessionError for a path that is not a session or has no complete trial, WrongUse for
    fewer than two textures.
    """
    with Session.open(path) as session:
        progress("reading trials", 0.0)
        rows, remarks = _complete_trials(session)
        trials = _labelled_trials(session, rows)
        held_out = classify_held_out(trials, seed=session.header.seed, progress=progress)
        origin = session_origin(session)
        progress("drawing", 1.0)
        accuracy = draw_accuracy(held_out, origin, figures / "accuracy")
        data = _most_active_trial(session, rows, trials, origin)
    raster = draw_raster(data, figures / "raster")
    return DemoResult(accuracy_sentence(held_out), raster, accuracy, held_out, remarks)


def accuracy_sentence(held_out: HeldOutPredictions) -> str:
    """Return the accuracy with n, its interval and chance in a sentence."""
    correct, n = int(held_out.correct_counts()[held_out.shown_components - 1]), held_out.n
    low, high = wilson_interval(correct, n)
    return (
        f"held-out accuracy {correct / n:.1%} ({correct} of n = {n} trials, 95 % interval "
        f"{low:.0%}–{high:.0%}; chance {held_out.chance:.1%}) with {held_out.shown_components} "
        f"principal components in {held_out.n_folds} stratified folds; taxel ranges (min/max), "
        "PCA and LDA from each fold's training part only"
    )


def session_origin(session: Session) -> str:
    """Return the origin of a session's data, for the foot of a figure."""
    header = session.header
    bench = "Simulated bench" if header.simulated else "Real bench"
    seed = f", seed {header.simulation['seed']}" if "seed" in header.simulation else ""
    return f"{bench} ({header.rig}{seed}) · session {session.path.name} · begun {header.start_utc}"


def _complete_trials(session: Session) -> tuple[list[int], tuple[str, ...]]:
    """Return the rows of committed trials without a gap, and a remark on the others."""
    committed = [int(row) for row in session.committed()]
    rows = [row for row in committed if len(session.samples(row)) == session.trials[row]["count"]]
    if not rows:
        raise SessionError(f"{session.path} holds no complete trial yet: record some first")
    left_out = [int(session.trials[row]["trial_id"]) for row in committed if row not in rows]
    if not left_out:
        return rows, ()
    listed = ", ".join(map(str, left_out[:5])) + (" …" if len(left_out) > 5 else "")
    return rows, (f"left out for gaps in their samples: trial {listed}",)


def _labelled_trials(session: Session, rows: list[int]) -> LabelledTrials:
    table = session.trials[rows]
    speeds = [float(v) for v in table["speed_mm_s"]]
    if min(speeds) <= 0:
        raise WrongUse(f"{session.path} holds trials without motion: textures need a moving drum")
    return LabelledTrials(
        [np.ascontiguousarray(session.samples(row)) for row in rows],
        speeds,
        [str(name) for name in table["texture"]],
    )


def _most_active_trial(
    session: Session, rows: list[int], trials: LabelledTrials, origin: str
) -> RasterData:
    """Return the trial with the highest rate of RA spikes, with its force."""
    ranges = Normalisation.from_samples(trials.samples, "all trials of the session")
    spikes = encode_trials(trials.samples, ranges)
    half = spikes[0].n_trains // 2
    ra_rates = [(s.row_start[-1] - s.row_start[half]) / max(s.n_samples, 1) for s in spikes]
    best = int(np.argmax(ra_rates))
    trial = session.trial_row(rows[best]).trial
    drum = session.drum(rows[best])
    return RasterData(
        f"Texture {trial.texture} at {trial.speed_mm_s:g} mm/s and {trial.force_g:g} g: "
        f"spikes of {spikes[best].n_trains} model neurons",
        f"{origin} · trial {trial.trial_id} · taxel ranges over the session",
        trials.samples[best],
        spikes[best],
        trial.speed_mm_s,
        trial.force_g,
        drum.loadcell_s,
        np.asarray(drum.loadcell["force_g"], np.float64),
    )
