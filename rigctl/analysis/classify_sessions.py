"""Predictions of a model for the trials of sessions: ``rigctl classify``.

A trial that the model was trained on is known by the hash of its samples, in every copy of its
session and whatever was recorded there since, so that it does not count as a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.force_gains import NO_PASSPORT, force_gains, sensor_warnings
from rigctl.analysis.force_scaling import (
    RateError,
    covered_trials,
    measure_rate_errors,
    transfer_warning,
    unseen_sessions,
)
from rigctl.analysis.notes import summarise_notes
from rigctl.analysis.pca_lda import log_posteriors
from rigctl.analysis.spike_counts import c_per_trial, hash_array
from rigctl.analysis.statistics import wilson_interval
from rigctl.analysis.trial_set import (
    TrialRef,
    TrialSet,
    check_source_wiring,
    counted,
    join_sessions,
    open_trials,
)
from rigctl.encoder.features import feature_matrices
from rigctl.encoder.force_gain import GAINED, ForceGain
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.reading import Reading
from rigctl.errors import SessionError, WrongUse
from rigctl.session.model_file import Model
from rigctl.session.sample_index import SampleFile
from rigctl.session.sensor_passport import SensorPassport
from rigctl.session.session import Session

MANY_CLIPPED = 0.01
MAX_LISTED_TAXELS = 6
CHUNK = 64
STAGE = "encoding and classifying"
Floats = NDArray[np.float64]
DECIMALS = 6


def prediction_remarks(
    model: Model,
    trials: TrialSet,
    unknown: Sequence[str],
    clipped: NDArray[np.float64],
    lengths: Sequence[int],
) -> list[str]:
    """Return all remarks as sentences.

    ``unknown``: textures that the model does not know, one per trial; ``clipped``: share of each
    taxel's readings outside its range; ``lengths``: samples of each trial.
    """
    remarks = [_clipping_remark(model, clipped)]
    if unknown:
        listed = ", ".join(sorted(set(unknown)))
        remarks.append(
            f"{len(unknown)} trials are of textures that are not in the model ({listed}): they "
            "have predictions, but do not count as right or wrong"
        )
    remarks += _length_remarks(model, trials, lengths)
    remarks += _condition_remarks(model, trials)
    if model.force == "texture":
        remarks.append(
            "each trial's SA current was scaled by the C of its own true texture: "
            "the model gets part of the answer"
        )
    if model.training.simulated != trials.simulated:
        origin = "simulated" if model.training.simulated else "real"
        remarks.append(f"the model was trained on {origin} recordings, these are not")
    return remarks


def _clipping_remark(model: Model, clipped: NDArray[np.float64]) -> str:
    start = (
        "readings are scaled by the model's taxel ranges "
        f"({model.normalisation.source}), not by these sessions' own"
    )
    worst = [i for i in np.argsort(-clipped, kind="stable") if clipped[i] > 0][:MAX_LISTED_TAXELS]
    if not worst:
        return f"{start}; no reading is outside them"
    parts = ", ".join(f"taxel {i + 1} {clipped[i]:.2%}" for i in worst)
    many = clipped.max() > MANY_CLIPPED
    cause = " (many: the sensor or its gain may have changed)" if many else ""
    return f"{start}; {clipped.mean():.2%} are outside and are clipped: {parts}{cause}"


def _length_remarks(model: Model, trials: TrialSet, lengths: Sequence[int]) -> list[str]:
    """Return remarks on trials that fill fewer or more windows than the features have."""
    layout = model.features
    spans = [
        int(layout.sample_windows(n, trial.speed_mm_s)[-1]) + 1
        for n, trial in zip(lengths, trials.trials, strict=True)
    ]
    longer = sum(span > layout.n_windows + 1 for span in spans)
    shorter = sum(span < layout.n_windows for span in spans) if layout.scaled else 0
    remarks = []
    if longer:
        remarks.append(
            f"{longer} trials are longer than the model's {layout.n_windows} windows: "
            "their ends are dropped"
        )
    if shorter:
        remarks.append(
            f"{shorter} trials cover less texture than the model's {layout.n_windows} windows: "
            "the missing windows read 0"
        )
    return remarks


def _condition_remarks(model: Model, trials: TrialSet) -> list[str]:
    remarks = []
    for values, trained, unit in (
        (trials.speeds_mm_s, model.training.speeds_mm_s, "mm/s"),
        (trials.forces_g, model.training.forces_g, "g"),
    ):
        new = [f"{value:g}" for value in values if value not in trained]
        if new:
            remarks.append(f"the model was trained on no trial at {', '.join(new)} {unit}")
    return remarks


class Prediction(NamedTuple):
    """The prediction for one trial; ``margin``: log posterior less that of the runner-up.

    ``right`` is None for a texture that is not in the model. ``trained_on``: whether the model was
    trained on this trial.
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
    trained_on: bool


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
        return sum(p.right is not None and p.trained_on for p in self.predictions)

    @property
    def unseen(self) -> Classification:
        """The predictions for trials that the model was not trained on."""
        predictions = tuple(p for p in self.predictions if not p.trained_on)
        confusion = _confusion(self.model, predictions)
        return replace(self, predictions=predictions, confusion=confusion)


class _PredictionTask(NamedTuple):
    files: tuple[SampleFile, ...]
    trials: tuple[TrialRef, ...]
    model: Model
    gains: tuple[ForceGain, ...]


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
    model: Model,
    paths: Sequence[Path],
    resources: Resources = SERIAL_RESOURCES,
    passport: SensorPassport | None = None,
) -> Classification:
    """Predict the texture of every complete trial of some sessions.

    ``passport``: the sensor's, in the place of those that the sessions carry.

    Raises WrongUse or SessionError for another number of taxels or sample rate, no motion, no
    complete trial, where the model's C lacks the speed, force or texture of every trial, or a
    Calibrated model meets a session without a passport.
    """
    known = model.training.trial_hashes
    if known is None:
        raise WrongUse(
            "the model is of an older version, which does not list the trials that it was trained "
            "on: train it again (rigctl analyse --save-model)"
        )
    _check_sensor(model, paths)
    trials = join_sessions(paths, resources.progress, model.parameters.reading)
    if model.c is not None:
        trials = covered_trials(trials, model.c, by_texture=model.force == "texture")
    trials = trials.without_gaps()
    gains = _gains(model, trials, passport)
    logs, lengths, n_clipped, hashes = _map_posteriors(model, trials, gains, resources)
    trained = [one in known for one in hashes]
    rows = zip(trials.trials, logs, trained, strict=True)
    predictions = tuple(_prediction(model, trials, *row) for row in rows)
    clipped = n_clipped / max(1, sum(lengths))
    errors, warnings = _rate_errors(model, trials, resources)
    changes = sensor_warnings(model.training.inputs, trials)
    unknown = [one.texture for one in predictions if one.right is None]
    remarks = prediction_remarks(model, trials, unknown, clipped, lengths)
    return Classification(
        model,
        trials,
        predictions,
        _confusion(model, predictions),
        tuple(clipped.tolist()),
        errors,
        (*changes, *warnings, *_trained_remarks(trained), *trials.remarks, *remarks),
    )


def _trained_remarks(trained: Sequence[bool]) -> list[str]:
    """Return a remark on the trials that the model was trained on."""
    if not any(trained):
        return []
    return [
        f"the model was trained on {sum(trained)} of these {len(trained)} trials: how it names "
        "them says nothing about others"
    ]


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


def _gains(
    model: Model, trials: TrialSet, passport: SensorPassport | None
) -> tuple[ForceGain, ...]:
    """Return the gain of each trial, none for a model without. Raises WrongUse."""
    kind = model.force
    if kind not in GAINED:
        return ()
    found = force_gains(trials, model.normalisation, REFERENCE_FORCE_G, passport)
    if kind not in found.by_kind:
        missing = NO_PASSPORT.format(path=trials.paths[0])
        raise WrongUse(f"the model is {model.representation}: {(*found.remarks, missing)[0]}")
    return found.by_kind[kind]


def _map_posteriors(
    model: Model, trials: TrialSet, gains: tuple[ForceGain, ...], resources: Resources
) -> _Posteriors:
    """Return the posteriors of all trials, computed in chunks."""
    chunks = [slice(at, at + CHUNK) for at in range(0, len(trials.trials), CHUNK)]
    tasks = [
        _PredictionTask(trials.files, trials.trials[chunk], model, gains[chunk]) for chunk in chunks
    ]
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
    encoder = (model.normalisation, [model.features], model.parameters)
    (features,) = feature_matrices(samples, speeds, *encoder, sa_scale=scale, gains=task.gains)
    return _Posteriors(log_posteriors(model, features), list(map(len, samples)), clipped, hashes)


def _prediction(
    model: Model, trials: TrialSet, trial: TrialRef, logs: Floats, trained_on: bool
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


def prediction_rows(found: Classification) -> list[dict[str, Any]]:
    """Return a mapping for each trial; ``right`` is None for a texture not in the model."""
    return [
        prediction._asdict()
        | {
            "posterior": round(prediction.posterior, DECIMALS),
            "margin": round(prediction.margin, DECIMALS),
        }
        for prediction in found.predictions
    ]


def as_dict(found: Classification) -> dict[str, Any]:
    """Return everything as plain values for JSON."""
    model, unseen = found.model, found.unseen
    return {
        "program": {"name": "rigctl", "version": __version__},
        "simulated": found.trials.simulated or model.training.simulated,
        "model": {
            "representation": model.representation,
            "components": model.components,
            "classes": list(model.classes),
            "c_knows_the_label": model.force == "texture",
            "encoder": model.parameters.as_dict(),
            "trained_utc": model.training.made_utc,
            "trained_on": list(model.training.inputs),
        },
        "inputs": list(found.trials.provenance),
        "trials": len(found.predictions),
        **_accuracy(found),
        "trained_on": found.n_trained_on,
        "without_trained": {**_accuracy(unseen), "confusion": unseen.confusion.tolist()},
        "confusion": found.confusion.tolist(),
        "clipped_share": list(found.clipped),
        "rate_error_of_c": [error.as_dict() for error in found.rate_errors],
        "remarks": list(found.remarks),
        "predictions": prediction_rows(found),
    }


def _accuracy(found: Classification) -> dict[str, Any]:
    correct, scored = found.n_correct, found.n_scored
    return {
        "asked": scored,
        "correct": correct,
        "accuracy": correct / scored if scored else None,
        "interval_95": list(wilson_interval(correct, scored)) if scored else None,
    }


def as_text(found: Classification, *, every_trial: bool = True) -> str:
    """Return remarks, a line for each trial, the confusion and the accuracy."""
    lines = [f"note: {note}" for note in summarise_notes(found.remarks, rest_in="--json")]
    if every_trial:
        lines += _trial_lines(found)
    if found.n_scored:
        lines += _confusion_lines(found)
    return "\n".join([*lines, summary(found)])


def summary(found: Classification) -> str:
    """Return the accuracy for trials that the model was not trained on, in a sentence."""
    start = "Simulated: " if found.trials.simulated else ""
    by = f"by {found.model.representation} with {found.model.components} components"
    if not found.n_scored:
        n = len(found.predictions)
        return f"{start}{n} trials classified; none of their textures is in the model"
    unseen = found.unseen
    if not unseen.n_scored:
        return (
            f"{start}the model was trained on all {found.n_scored} trials ({found.n_correct} "
            f"right), which says nothing about others: classify other sessions; {by}"
        )
    correct, scored = unseen.n_correct, unseen.n_scored
    low, high = wilson_interval(correct, scored)
    return (
        f"{start}{correct} of {scored} trials right ({correct / scored:.1%}, 95 % interval "
        f"{low:.0%}–{high:.0%}; chance {1 / len(found.model.classes):.1%}) {by}; {_origin(found)}"
    )


def _origin(found: Classification) -> str:
    """Return which trials the accuracy leaves out."""
    if found.n_trained_on:
        return f"without the {found.n_trained_on} that the model was trained on"
    return "the model was trained on none of them"


def _trial_lines(found: Classification) -> list[str]:
    marks = {True: "right", False: "WRONG", None: "not in the model"}
    trained = {True: ", the model was trained on it", False: ""}
    several = len(found.trials.paths) > 1
    return [
        f"{p.session + ' ' if several else ''}trial {p.trial_id}: "
        f"{p.predicted} ({p.posterior:.1%}, then {p.runner_up}, margin "
        f"{p.margin:.2f}); true {p.texture}: {marks[p.right]}{trained[p.trained_on]}"
        for p in found.predictions
    ]


def _confusion_lines(found: Classification) -> list[str]:
    if found.unseen.n_scored:
        found = found.unseen
    names = found.model.classes
    width = max(4, *(len(name) + 1 for name in names))
    head = "".join(f"{name:>{width}}" for name in names)
    body = [
        f"{name:>{width}}" + "".join(f"{count:>{width}}" for count in row)
        for name, row in zip(names, found.confusion.tolist(), strict=True)
        if sum(row)
    ]
    return ["rows: true, columns: predicted", " " * width + head, *body]
