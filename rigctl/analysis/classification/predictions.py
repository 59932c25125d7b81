"""Predictions as JSON, as CSV and as text."""

from __future__ import annotations

from typing import Any

from rigctl import __version__
from rigctl.analysis.classification.classify_sessions import Classification
from rigctl.analysis.data.notes import summarise_notes
from rigctl.analysis.paper.statistics import wilson_interval

DECIMALS = 6


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
        "perhaps_trained_on": found.n_unknown,
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
        return f"{start}{_nothing_new(found)} {by}"
    correct, scored = unseen.n_correct, unseen.n_scored
    low, high = wilson_interval(correct, scored)
    return (
        f"{start}{correct} of {scored} trials right ({correct / scored:.1%}, 95 % interval "
        f"{low:.0%}–{high:.0%}; chance {1 / len(found.model.classes):.1%}) {by}; {_origin(found)}"
    )


def _nothing_new(found: Classification) -> str:
    """Return why there is no accuracy: the model knows all trials, or may know them."""
    n, right = found.n_scored, found.n_correct
    if found.n_unknown:
        return (
            f"it is not known whether the model was trained on these {n} trials ({right} right), "
            "so there is no accuracy: train it again, or classify other sessions;"
        )
    return (
        f"the model was trained on all {n} trials ({right} right), which says nothing about "
        "others: classify other sessions;"
    )


def _origin(found: Classification) -> str:
    """Return which trials the accuracy leaves out."""
    if found.n_unknown:
        n = found.n_trained_on + found.n_unknown
        return f"without {n} that the model was or may have been trained on"
    if found.n_trained_on:
        return f"without the {found.n_trained_on} that the model was trained on"
    return "the model was trained on none of them"


def _trial_lines(found: Classification) -> list[str]:
    marks = {True: "right", False: "WRONG", None: "not in the model"}
    trained = {True: ", the model was trained on it", False: "", None: ", perhaps trained on"}
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
