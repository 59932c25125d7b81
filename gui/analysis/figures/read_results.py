"""The figures of a report from its ``results.json``. This module does not import Qt."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gui.analysis.export.value_file import data_words
from gui.analysis.figures.accuracy import (
    AccuracyCurve,
    AccuracyPanel,
    AccuracyPlot,
    PublishedAccuracy,
)
from gui.analysis.figures.confusion import ConfusionCounts, ConfusionPlot

SEEN = "C knew the true texture of the tested trials."
KEYS = {"Original": "original", "Speed Scaled": "speed"}
"""Keys of the moving finger's representations, which have the drum's names."""


def read_values(report: Path) -> dict[str, Any]:
    """Return what a report of this program has written as its results."""
    values: dict[str, Any] = json.loads((report / "results.json").read_text(encoding="utf-8"))
    return values


def origin_words(values: Mapping[str, Any], report: Path) -> str:
    """Return where the numbers of a report come from."""
    return f"{data_words(simulated=values['simulated'])} · {report.name}"


def drum_accuracy(values: Mapping[str, Any], origin: str) -> AccuracyPlot:
    """Return the curves of Figure 3, a panel for each task."""
    draws = values["settings"]["iterations"]
    panels = tuple(
        AccuracyPanel(
            _task_title(task),
            100 * task["chance"],
            tuple(_drum_curves(task)),
            f"sd over {draws} draws",
        )
        for task in values["tasks"].values()
    )
    return AccuracyPlot(panels, origin, values["simulated"])


def drum_confusion(values: Mapping[str, Any], origin: str) -> ConfusionPlot:
    """Return the confusion matrix of each task and representation."""
    matrices = tuple(
        ConfusionCounts(
            _task_title(task),
            curve["name"],
            task["shown_components"],
            tuple(task["classes"]),
            np.array(curve["confusion"], np.int64),
            SEEN if curve["c_knows_the_label"] else "",
        )
        for task in values["tasks"].values()
        for curve in task["representations"].values()
    )
    return ConfusionPlot(matrices, origin, values["simulated"])


def finger_accuracy(values: Mapping[str, Any], figure: str, origin: str) -> AccuracyPlot | None:
    """Return the curves of one figure of the moving finger, None without its tasks."""
    tasks = [task for task in values["tasks"].values() if task["figure"] == figure]
    panels = tuple(
        AccuracyPanel(
            _task_title(task), 100 * task["chance"], tuple(_finger_curves(task)), _spread(task)
        )
        for task in tasks
    )
    return AccuracyPlot(panels, origin, values["simulated"]) if panels else None


def _task_title(task: Mapping[str, Any]) -> str:
    return " ".join(filter(None, (task["figure"], task["title"])))


def _drum_curves(task: Mapping[str, Any]) -> Iterator[AccuracyCurve]:
    from rigctl.analysis import published

    for key, curve in task["representations"].items():
        paper = None
        if key in task["paper"]:
            mean, sd = task["paper"][key]
            paper = PublishedAccuracy(mean, sd, published.K_MAX)
        yield AccuracyCurve(
            key, curve["name"], _percent(curve["mean"]), _percent(curve["sd"] or ()), paper
        )


def _finger_curves(task: Mapping[str, Any]) -> Iterator[AccuracyCurve]:
    for name, curve in task["curves"].items():
        quoted = task["paper"]["accuracy"][name]
        paper = PublishedAccuracy(quoted["percent"], None, quoted["components"])
        spread = _percent(curve["sd"] or curve["standard_error"] or ())
        yield AccuracyCurve(KEYS[name], name, _percent(curve["mean"]), spread, paper)


def _spread(task: Mapping[str, Any]) -> str:
    """Return what the bars of a task of the finger are."""
    has_sd = all(curve["sd"] for curve in task["curves"].values())
    return f"sd over {task['n']} draws" if has_sd else "standard error of the share"


def _percent(shares: Any) -> tuple[float, ...]:
    return tuple(100 * share for share in shares)
