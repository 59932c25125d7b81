"""Predictions of a model for the trials of sessions: ``rigctl classify``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.posteriors import log_posteriors
from rigctl.analysis.classification.prediction_remarks import prediction_remarks
from rigctl.analysis.classification.trained_trials import find_trained, trained_remarks
from rigctl.analysis.data.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.data.condition_tasks import c_per_trial
from rigctl.analysis.data.fingerprint import hash_array
from rigctl.analysis.data.trial_set import (
    TrialRef,
    TrialSet,
    counted,
    join_sessions,
    open_trials,
)
from rigctl.analysis.data.wiring_check import check_source_wiring
from rigctl.analysis.features.transferred_c import (
    RateError,
    covered_trials,
    measure_rate_errors,
    transfer_warning,
    unseen_sessions,
)
from rigctl.encoding.features import feature_matrices
from rigctl.encoding.reading import Reading
from rigctl.errors import SessionError
from rigctl.session.model_file import Model
from rigctl.session.sample_index import SampleFile
from rigctl.session.session import Session

CHUNK = 64
STAGE = "encoding and classifying"

Floats = NDArray[np.float64]


class Prediction(NamedTuple):
    """The prediction for one trial; ``margin``: log posterior less that of the runner-up.

    ``right`` is None for a texture that is not in the model. ``trained_on``: whether the model was
    trained on this trial, None where that is not known.
    """

    session: str
    trial_id: int
    texture: str
    speed_mm_s: float
    force_g: float
    predicted: str
    right: bool | None
    posterior: float
    runner_up: str
    margin: float
    trained_on: bool | None


@dataclass(frozen=True, slots=True)
class Classification:
    """Predictions for all trials; ``clipped``: share of each taxel's readings outside its range.

    ``confusion``: int64 (classes, classes) of the trials whose texture is in the model; rows: true.
    """

    model: Model
    trials: TrialSet
    predictions: tuple[Prediction, ...]
    confusion: NDArray[np.int64]
    clipped: tuple[float, ...]
    rate_errors: tuple[RateError, ...]
    remarks: tuple[str, ...]

    @property
    def n_scored(self) -> int:
        """Trials whose texture is in the model."""
        return int(self.confusion.sum())

    @property
    def n_correct(self) -> int:
        """Scored trials with the right prediction."""
        return int(np.trace(self.confusion))

    @property
    def n_trained_on(self) -> int:
        """Scored trials that the model was trained on."""
        return sum(p.right is not None and p.trained_on is True for p in self.predictions)

    @property
    def n_unknown(self) -> int:
        """Scored trials of which it is not known whether the model was trained on them."""
        return sum(p.right is not None and p.trained_on is None for p in self.predictions)

    @property
    def unseen(self) -> Classification:
        """The predictions for trials that the model was not trained on."""
        predictions = tuple(p for p in self.predictions if p.trained_on is False)
        confusion = _confusion(self.model, predictions)
        return replace(self, predictions=predictions, confusion=confusion)


class _PredictionTask(NamedTuple):
    files: tuple[SampleFile, ...]
    trials: tuple[TrialRef, ...]
    model: Model


class _Posteriors(NamedTuple):
    """Posteriors of trials, and what else their samples say.

    ``logs``: float64 (trials, classes); ``clipped``: clipped samples, int64 (taxels,);
    ``hashes``: XXH3 of each trial's samples.
    """

    logs: Floats
    lengths: list[int]
    clipped: NDArray[np.int64]
    hashes: list[int]


def classify(
    model: Model, paths: Sequence[Path], resources: Resources = SERIAL_RESOURCES
) -> Classification:
    """Predict the texture of every complete trial of some sessions.

    Raises WrongUse or SessionError for another number of taxels or sample rate, no motion, no
    complete trial, or where the model's C lacks the speed, force or texture of every trial.
    """
    _check_sensor(model, paths)
    trials = join_sessions(paths, resources.progress, model.parameters.reading)
    if model.c is not None:
        trials = covered_trials(trials, model.c, by_texture=model.force == "texture")
    trials = trials.without_gaps()
    logs, lengths, n_clipped, hashes = _map_posteriors(model, trials, resources)
    trained = find_trained(model, trials, hashes, resources)
    rows = zip(trials.trials, logs, trained, strict=True)
    predictions = tuple(_prediction(model, trials, *row) for row in rows)
    clipped = n_clipped / max(1, sum(lengths))
    errors, warnings = _rate_errors(model, trials, resources)
    unknown = [one.texture for one in predictions if one.right is None]
    remarks = prediction_remarks(model, trials, unknown, clipped, lengths)
    return Classification(
        model,
        trials,
        predictions,
        _confusion(model, predictions),
        tuple(clipped.tolist()),
        errors,
        (*warnings, *trained_remarks(trained), *trials.remarks, *remarks),
    )


def _check_sensor(model: Model, paths: Sequence[Path]) -> None:
    inputs = model.training.inputs
    model_scaling: list[list[float]] = inputs[0].get("scaling", []) if inputs else []
    for path in paths:
        with Session.open(path) as session:
            header, scaling = session.header, [list(pair) for pair in session.scaling]
            source = {"path": str(path), "wiring": session.wiring}
        for theirs, ours, what in (
            (header.n_taxels, model.n_taxels, "taxels"),
            (header.sample_rate_hz, model.sample_rate_hz, "samples a second"),
        ):
            if theirs != ours:
                raise SessionError(
                    f"{path} has {theirs} {what}, the model was trained with {ours}: "
                    "train one on recordings of this kind"
                )
        check_source_wiring("the model", inputs, [source])
        if scaling != model_scaling:
            raise SessionError(
                f"{path} stores readings on another scale than the sessions of the model: import "
                "it with the same low and high under [taxels] as theirs"
            )


def _map_posteriors(model: Model, trials: TrialSet, resources: Resources) -> _Posteriors:
    """Return the posteriors of all trials, computed in chunks."""
    chunks = [trials.trials[at : at + CHUNK] for at in range(0, len(trials.trials), CHUNK)]
    tasks = [_PredictionTask(trials.files, chunk, model) for chunk in chunks]
    found = resources.map(_posteriors, tasks, STAGE)
    logs, lengths, clipped, hashes = zip(*found, strict=True)
    return _Posteriors(
        np.concatenate(logs),
        list(chain(*lengths)),
        np.sum(clipped, axis=0),
        list(chain(*hashes)),
    )


def _posteriors(task: _PredictionTask) -> _Posteriors:
    model = task.model
    with open_trials(task.files) as reader:
        samples = [reader.read(trial) for trial in task.trials]
    hashes = list(map(hash_array, samples))
    if model.parameters.reading is not Reading.COUNTS:
        with open_trials(counted(task.files)) as reader:
            hashes = [hash_array(reader.read(trial)) for trial in task.trials]
    clipped = np.sum([model.normalisation.count_clipped(readings) for readings in samples], axis=0)
    scale = None
    if model.c is not None:
        scale = c_per_trial(task.trials, model.c, blind=model.force == "blind")
    speeds = [trial.speed_mm_s for trial in task.trials]
    (features,) = feature_matrices(
        samples, speeds, model.normalisation, [model.features], model.parameters, sa_scale=scale
    )
    return _Posteriors(log_posteriors(model, features), list(map(len, samples)), clipped, hashes)


def _prediction(
    model: Model, trials: TrialSet, trial: TrialRef, logs: Floats, trained_on: bool | None
) -> Prediction:
    best = int(logs.argmax())
    others = logs.copy()
    others[best] = -np.inf
    second = int(others.argmax())
    predicted = model.classes[best]
    return Prediction(
        str(trials.paths[trial.session]),
        trial.trial_id,
        trial.texture,
        trial.speed_mm_s,
        trial.force_g,
        predicted,
        predicted == trial.texture if trial.texture in model.classes else None,
        float(np.exp(logs[best])),
        model.classes[second],
        float(logs[best] - logs[second]),
        trained_on,
    )


def _confusion(model: Model, predictions: Sequence[Prediction]) -> NDArray[np.int64]:
    table = np.zeros((len(model.classes), len(model.classes)), np.int64)
    index = {name: i for i, name in enumerate(model.classes)}
    for prediction in predictions:
        if prediction.right is not None:
            table[index[prediction.texture], index[prediction.predicted]] += 1
    return table


def _rate_errors(
    model: Model, trials: TrialSet, resources: Resources
) -> tuple[tuple[RateError, ...], list[str]]:
    """Return the rate errors of C and a warning, where the model was not trained on a session."""
    if model.c is None:
        return (), []
    unseen = unseen_sessions(trials, model.training.inputs, resources)
    if not unseen:
        return (), []
    blind = model.force == "blind"
    errors = measure_rate_errors(
        trials, model.c, model.normalisation, model.parameters, resources, blind=blind
    )
    return tuple(errors), [transfer_warning(errors, model.c, unseen)]
