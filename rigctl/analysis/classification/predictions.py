"""A model's answers as plain values, as CSV, and as lines for people."""

from __future__ import annotations

import csv
import io
from typing import Any

from rigctl import __version__
from rigctl.analysis.classification.classify_sessions import Classification
from rigctl.analysis.paper.statistics import wilson_interval

COLUMNS = (
    "session", "trial_id", "texture", "speed_mm_s", "force_g", "predicted", "right", "posterior",
    "runner_up", "margin",
)  # fmt: skip
DECIMALS = 6


def rows(found: Classification) -> list[dict[str, Any]]:
    """One mapping a trial; ``right`` is None where the model does not know the texture."""
    return [
        {
            **{name: getattr(answer, name) for name in COLUMNS},
            "posterior": round(answer.posterior, DECIMALS),
            "margin": round(answer.margin, DECIMALS),
        }
        for answer in found.predictions
    ]


def as_plain(found: Classification) -> dict[str, Any]:
    """Everything, as JSON can hold it."""
    model = found.model
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
        "asked": found.asked,
        "correct": found.correct,
        "accuracy": found.correct / found.asked if found.asked else None,
        "interval_95": list(wilson_interval(found.correct, found.asked)) if found.asked else None,
        "confusion": found.confusion.tolist(),
        "clipped_share": list(found.clipped),
        "rate_error_of_c": [miss.as_dict() for miss in found.misses],
        "remarks": list(found.remarks),
        "predictions": rows(found),
    }


def as_csv(found: Classification) -> str:
    """A row a trial; what is not known is empty."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows(found):
        right = row["right"]
        writer.writerow(row | {"right": "" if right is None else "yes" if right else "no"})
    return out.getvalue()


def as_lines(found: Classification, *, every_trial: bool = True) -> str:
    """Notes, a line a trial, the confusion, and the accuracy."""
    lines = [f"note: {remark}" for remark in found.remarks]
    if every_trial:
        lines += _trial_lines(found)
    if found.asked:
        lines += _confusion_lines(found)
    return "\n".join([*lines, sentence(found)])


def sentence(found: Classification) -> str:
    """The answer in words."""
    start = "Simulated: " if found.trials.simulated else ""
    correct, asked = found.correct, found.asked
    if not asked:
        n = len(found.predictions)
        return f"{start}{n} trials answered; the model knows none of their textures"
    low, high = wilson_interval(correct, asked)
    return (
        f"{start}{correct} of {asked} trials told right ({correct / asked:.1%}, 95 % interval "
        f"{low:.0%}–{high:.0%}; chance {1 / len(found.model.classes):.1%}) by "
        f"{found.model.representation} with {found.model.components} components"
    )


def _trial_lines(found: Classification) -> list[str]:
    marks = {True: "right", False: "WRONG", None: "not known"}
    several = len(found.trials.paths) > 1
    return [
        f"{answer.session + ' ' if several else ''}trial {answer.trial_id}: "
        f"{answer.predicted} ({answer.posterior:.1%}, then {answer.runner_up}, margin "
        f"{answer.margin:.2f}); true {answer.texture}: {marks[answer.right]}"
        for answer in found.predictions
    ]


def _confusion_lines(found: Classification) -> list[str]:
    names = found.model.classes
    width = max(4, *(len(name) + 1 for name in names))
    head = "".join(f"{name:>{width}}" for name in names)
    body = [
        f"{name:>{width}}" + "".join(f"{count:>{width}}" for count in row)
        for name, row in zip(names, found.confusion.tolist(), strict=True)
        if sum(row)
    ]
    return ["rows: true, columns: predicted", " " * width + head, *body]
