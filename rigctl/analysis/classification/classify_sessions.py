"""Sessions asked of a model: a prediction a trial, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.posteriors import log_posteriors
from rigctl.analysis.classification.prediction_remarks import sentences
from rigctl.analysis.data.trial_set import TrialRef, TrialSet, join_sessions, opened
from rigctl.analysis.data.wiring_check import check_learnt
from rigctl.analysis.execution.executor import HERE, Executor, Progress, work_through
from rigctl.analysis.features.transferred_c import (
    RateError,
    check_covers,
    rate_errors,
    unseen_sessions,
    warning,
)
from rigctl.encoding.features import feature_matrices
from rigctl.errors import SessionError
from rigctl.session.files.model import Model
from rigctl.session.read.sample_index import SampleFile
from rigctl.session.read.session import Session

CHUNK = 64
STAGE = "encoding and classifying"


class Prediction(NamedTuple):
    """One trial's answer. ``margin``: ln of the posterior over that of the runner-up."""

    session: str
    trial_id: int
    texture: str
    speed_mm_s: float
    force_g: float
    predicted: str
    posterior: float
    runner_up: str
    margin: float
    known: bool

    @property
    def right(self) -> bool | None:
        """Whether it is the true texture; None where the model does not know that texture."""
        return self.predicted == self.texture if self.known else None


@dataclass(frozen=True, slots=True)
class Classification:
    """Answers for all trials. ``confusion``: int64 (classes, classes), rows the truth, of trials
    whose texture the model knows. ``clipped``: share of each taxel's readings outside its range.
    """

    model: Model
    trials: TrialSet
    predictions: tuple[Prediction, ...]
    confusion: NDArray[np.int64]
    clipped: tuple[float, ...]
    misses: tuple[RateError, ...]
    remarks: tuple[str, ...]

    @property
    def asked(self) -> int:
        """Trials whose texture the model knows."""
        return int(self.confusion.sum())

    @property
    def correct(self) -> int:
        """How many of these were told right."""
        return int(np.trace(self.confusion))


class _PredictionJob(NamedTuple):
    files: tuple[SampleFile, ...]
    trials: tuple[TrialRef, ...]
    model: Model


class _Answered(NamedTuple):
    """``logs``: float64 (trials, classes); ``clipped``: int64 (taxels,), of ``read`` samples."""

    logs: NDArray[np.float64]
    lengths: list[int]
    clipped: NDArray[np.int64]
    read: int


def classify(
    model: Model,
    paths: Sequence[Path],
    *,
    crew: Executor = HERE,
    progress: Progress = lambda stage, done, all_: None,
) -> Classification:
    """Ask a model for every complete trial of some sessions.

    Raises WrongUse or SessionError where it cannot answer: another number of taxels or sample
    rate, no motion, a speed, force or texture that its C lacks, no complete trial.
    """
    _check_sensor(model, paths)
    trials = join_sessions(paths)
    if model.c is not None:
        check_covers(trials, model.c, by_texture=model.force == "texture")
    torn = [i for i, trial in enumerate(trials.trials) if not trial.place.complete]
    kept = trials.without(torn, "gaps in their samples")
    chunks = [kept.trials[at : at + CHUNK] for at in range(0, len(kept.trials), CHUNK)]
    jobs = [_PredictionJob(kept.files, chunk, model) for chunk in chunks]
    parts = list(work_through(_answered, jobs, crew=crew, stage=STAGE, progress=progress))
    predictions = _predictions(model, kept, np.concatenate([part.logs for part in parts]))
    clipped = np.sum([p.clipped for p in parts], axis=0) / max(1, sum(p.read for p in parts))
    misses, warned = _carried(model, kept, crew, progress)
    lengths = [n for part in parts for n in part.lengths]
    new = [answer.texture for answer in predictions if not answer.known]
    remarks = (*warned, *kept.remarks, *sentences(model, kept, new, clipped, lengths))
    return Classification(
        model,
        kept,
        predictions,
        _confusion(model, predictions),
        tuple(clipped.tolist()),
        misses,
        remarks,
    )


def _check_sensor(model: Model, paths: Sequence[Path]) -> None:
    for path in paths:
        with Session.open(path) as session:
            header, scaling = session.header, [list(pair) for pair in session.scaling]
            order = {"path": str(path), "wiring": session.wiring}
        for theirs, ours, what in (
            (header.n_taxels, model.n_taxels, "taxels"),
            (header.sample_rate_hz, model.sample_rate_hz, "samples a second"),
        ):
            if theirs != ours:
                raise SessionError(
                    f"{path} has {theirs} {what}, the model was trained with {ours}: "
                    "train one on recordings of this kind"
                )
        check_learnt("the model", model.training.inputs, [order])
        if scaling != _scaling_of(model):
            raise SessionError(
                f"{path} stores readings on another scale than the sessions of the model: import "
                "it with the same low and high under [taxels] as theirs"
            )


def _scaling_of(model: Model) -> list[list[float]]:
    """What the stored counts of the sessions that were learnt from are."""
    return next((source.get("scaling", []) for source in model.training.inputs), [])


def _answered(job: _PredictionJob) -> _Answered:
    model = job.model
    with opened(job.files) as reader:
        samples = [reader.of(trial) for trial in job.trials]
    clipped = np.zeros(model.n_taxels, np.int64)
    for readings in samples:
        clipped += model.normalisation.clipped(readings)
    speeds = [trial.speed_mm_s for trial in job.trials]
    ways = (model.normalisation, [model.features], model.parameters)
    features = feature_matrices(samples, speeds, *ways, sa_scale=_scale(model, job.trials))[0]
    lengths = [len(readings) for readings in samples]
    return _Answered(log_posteriors(model, features), lengths, clipped, sum(lengths))


def _scale(model: Model, trials: Sequence[TrialRef]) -> NDArray[np.float64] | None:
    """Factor on the SA current of each trial and taxel, None for 1."""
    c = model.c
    if c is None:
        return None
    if model.force == "texture":
        return np.array([c.of(t.texture, t.speed_mm_s, t.force_g) for t in trials])
    return np.array([c.texture_blind(t.speed_mm_s, t.force_g) for t in trials])


def _predictions(
    model: Model, trials: TrialSet, logs: NDArray[np.float64]
) -> tuple[Prediction, ...]:
    answers = []
    for trial, row in zip(trials.trials, logs, strict=True):
        best = int(row.argmax())
        others = row.copy()
        others[best] = -np.inf
        second = int(others.argmax())
        answers.append(
            Prediction(
                str(trials.paths[trial.session]),
                trial.trial_id,
                trial.texture,
                trial.speed_mm_s,
                trial.force_g,
                model.classes[best],
                float(np.exp(row[best])),
                model.classes[second],
                float(row[best] - row[second]),
                trial.texture in model.classes,
            )
        )
    return tuple(answers)


def _confusion(model: Model, predictions: Sequence[Prediction]) -> NDArray[np.int64]:
    table = np.zeros((len(model.classes), len(model.classes)), np.int64)
    place = {name: i for i, name in enumerate(model.classes)}
    for answer in predictions:
        if answer.known:
            table[place[answer.texture], place[answer.predicted]] += 1
    return table


def _carried(
    model: Model, trials: TrialSet, crew: Executor, progress: Progress
) -> tuple[tuple[RateError, ...], list[str]]:
    """The rate error of C and its warning, where a session is none of those learnt from."""
    if model.c is None:
        return (), []
    foreign = unseen_sessions(trials, model.training.inputs, progress)
    if not foreign:
        return (), []
    blind = model.force == "blind"
    ways = (model.c, model.normalisation, model.parameters)
    misses = rate_errors(trials, *ways, blind=blind, crew=crew, progress=progress)
    where = ", ".join(map(str, foreign))
    return tuple(misses), [warning(misses, model.c, where)]
