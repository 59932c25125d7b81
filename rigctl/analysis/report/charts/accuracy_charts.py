"""Figure 3 for the page: accuracy over components, the paper's values, and asterisks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.analysis.paper import published
from rigctl.analysis.paper.comparisons import NAME_OF
from rigctl.analysis.report.charts.line_chart import (
    ChartMark,
    ChartSeries,
    LineChart,
    LinePanel,
)

Values = Mapping[str, Any]

STYLES = {
    "original": "ink",
    "speed": "blue",
    "force": "red",
    "speed_force": "green",
    "force_blind": "red dashed",
    "speed_force_blind": "green dashed",
}
"""The paper's colours; dashed where C is texture-blind."""
PAPER_NOTE = (
    f"Diamonds: the paper's Table 1 with {published.K_MAX} components, in the colour of its curve."
)
BLIND_NOTE = (
    "Force Scaled curves use the C of the true texture, which a dashed, texture-blind one does not."
)


def accuracy_chart(results: Values) -> LineChart:
    """Return Figure 3 of a report, from the values of its ``results.json``."""
    tasks = results["tasks"].values()
    n = results["settings"]["iterations"]
    bars = "bars: standard deviation" if n > 1 else "one draw, no spread"
    notes = [f"Mean of {n} draw{'s' if n > 1 else ''}; {bars}."]
    if any(task["paper"] for task in tasks):
        notes.append(PAPER_NOTE)
    if any(key.endswith("_blind") for task in tasks for key in task["representations"]):
        notes.append(BLIND_NOTE)
    panels = [_panel(task) for task in tasks]
    return LineChart("Accuracy over principal components", panels, notes)


def _panel(task: Values) -> LinePanel:
    chance = 100 * task["chance"]
    most = max(task["k_max"], published.K_MAX if task["paper"] else 1)
    return LinePanel(
        f"{task['figure']}  {task['title']}".strip(),
        [_series(task, key, task["representations"][key]) for key in _ordered(task)],
        "principal components",
        "accuracy (%)",
        (0.0, most + 1.0),
        (0.0, 100.0),
        x_name="components",
        level=(chance, f"chance {chance:.3g} %"),
    )


def _ordered(task: Values) -> list[str]:
    return [key for key in NAME_OF if key in task["representations"]]


def _series(task: Values, key: str, curve: Values) -> ChartSeries:
    mean = [100 * share for share in curve["mean"]]
    return ChartSeries(
        key,
        NAME_OF[key],
        STYLES[key],
        [float(k) for k in range(1, len(mean) + 1)],
        mean,
        None if curve["sd"] is None else [100 * share for share in curve["sd"]],
        marks=_paper_mark(task, key),
    )


def _paper_mark(task: Values, key: str) -> list[ChartMark]:
    if key not in task["paper"]:
        return []
    mean, sd = task["paper"][key]
    return [ChartMark(float(published.K_MAX), mean, f"the paper {mean:.2f} ± {sd:.2f} %")]
