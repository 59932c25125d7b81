"""The demo's analysis of sessions: encode, classify held-out trials, draw two figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.executors import Progress
from rigctl.analysis.held_out import (
    HeldOutPredictions,
    classify_held_out,
    with_repeats,
)
from rigctl.analysis.report.figure import Figure, Matrix, Series
from rigctl.analysis.report.figures import RasterData, draw_raster
from rigctl.analysis.report.result_figures import accuracy_panel
from rigctl.analysis.report.vega import save_figure
from rigctl.analysis.statistics import wilson_interval
from rigctl.analysis.trial_set import Design, TrialSet, join_sessions, open_trials
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.session import Session

HELD_OUT = "Held-out trials"
MOST_NAMED = 3
"""How many sessions the foot of a figure names."""


@dataclass(frozen=True, slots=True)
class DemoResult:
    """A summary sentence, the figures, the predictions, and remarks.

    ``shown``: the trial of the raster. ``origin``: the source of the data, in a few words.
    """

    sentence: str
    raster: Path
    accuracy: Path
    held_out: HeldOutPredictions
    remarks: tuple[str, ...]
    shown: RasterData
    origin: str
    simulated: bool


def analyse_sessions(
    paths: Sequence[Path], figures: Path, *, progress: Progress = lambda stage, done, total: None
) -> DemoResult:
    """Classify the textures of sessions together; draw the figures into the folder ``figures``.

    Raises SessionError for a path that is not a session, for sessions of different sensors, or
    without a complete trial with motion, WrongUse for fewer than two textures.
    """
    progress("reading trials", 0, 1)
    trials = with_repeats(join_sessions(paths, progress).without_gaps())
    with open_trials(trials.files) as reader:
        samples = [reader.read(trial) for trial in trials.trials]
    seed = trials.provenance[0]["seed"]
    held_out = classify_held_out(samples, Design.from_trials(trials), seed=seed, progress=progress)
    progress("drawing", 0, 1)
    origin, shown = _origin(trials), _most_active_trial(trials, samples)
    both = [*held_out_accuracy(held_out).panels, *held_out_confusion(held_out).panels]
    figure = Figure(accuracy_title(held_out), both, held_out_accuracy(held_out).notes, columns=2)
    accuracy = save_figure(figure, figures / "accuracy", origin)
    raster = draw_raster(shown, figures / "raster")
    return DemoResult(
        accuracy_sentence(held_out), raster, accuracy, held_out, trials.remarks,
        shown, origin, trials.simulated,
    )  # fmt: skip


def held_out_accuracy(held_out: HeldOutPredictions) -> Figure:
    """Return the accuracy of the quick check over components."""
    n, correct = held_out.n, held_out.correct_counts()
    low, high = wilson_interval(correct, n)
    ends = list(zip((100 * low).tolist(), (100 * high).tolist(), strict=True))
    y = (100 * correct / n).tolist()
    series = Series("Speed Scaled", "blue", range(1, len(y) + 1), y, ends)
    panel = accuracy_panel(HELD_OUT, [series], held_out.chance)
    note = f"n = {n} trials in {held_out.n_folds} folds, each tested once; bars: 95 % interval."
    return Figure(HELD_OUT, [panel], [note])


def held_out_confusion(held_out: HeldOutPredictions) -> Figure:
    """Return the confusion matrix of the quick check."""
    note = f"trials with {held_out.shown_components} components"
    matrix = Matrix("Speed Scaled", [note], held_out.classes, held_out.confusion().tolist())
    return Figure(HELD_OUT, [matrix])


def accuracy_title(held_out: HeldOutPredictions) -> str:
    """Return the title of the quick check's figure."""
    correct, n = int(held_out.correct_counts()[held_out.shown_components - 1]), held_out.n
    return (
        f"Held-out trials classified correctly: {correct} of {n} "
        f"({correct / n:.0%}) with {held_out.shown_components} components"
    )


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


def _origin(trials: TrialSet) -> str:
    """Return the origin of the data, for the foot of a figure."""
    if (n := len(trials.paths)) > 1:
        names = ", ".join(path.name for path in trials.paths)
        which = f"sessions {names}" if n <= MOST_NAMED else f"{n} sessions"
        return f"{_benches(trials)} · {which}"
    source = trials.provenance[0]
    seed = "" if source["simulation_seed"] is None else f", seed {source['simulation_seed']}"
    session = f"session {trials.paths[0].name} · begun {source['begun_utc']}"
    return f"{_benches(trials)} ({source['rig']}{seed}) · {session}"


def _benches(trials: TrialSet) -> str:
    simulated = {bool(source["simulated"]) for source in trials.provenance}
    if len(simulated) > 1:
        return "Simulated and real bench"
    return "Simulated bench" if simulated == {True} else "Real bench"


def _most_active_trial(trials: TrialSet, samples: Sequence[NDArray[np.uint16]]) -> RasterData:
    """Return the trial with the highest rate of RA spikes, with its force."""
    ranges = Normalisation.from_samples(samples, "all trials")
    spikes = encode_trials(samples, ranges)
    half = spikes[0].n_trains // 2
    ra_rates = [(s.row_start[-1] - s.row_start[half]) / max(s.n_samples, 1) for s in spikes]
    best = int(np.argmax(ra_rates))
    trial = trials.trials[best]
    path = trials.paths[trial.session]
    of = f" of {path.name}" if len(trials.paths) > 1 else ""
    with Session.open(path) as session:
        drum = session.drum(trial.row)
    return RasterData(
        f"Texture {trial.texture} at {trial.speed_mm_s:g} mm/s and {trial.force_g:g} g: "
        f"spikes of {spikes[best].n_trains} model neurons",
        f"{_origin(trials)} · trial {trial.trial_id}{of} · taxel ranges over all trials",
        samples[best],
        spikes[best],
        trial.speed_mm_s,
        trial.force_g,
        drum.loadcell_s,
        np.asarray(drum.loadcell["force_g"], np.float64),
        trials.sensor_layout,
    )
