"""Figure 3 for the page: accuracy over components, the paper's values, and asterisks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis import published
from rigctl.analysis.comparisons import NAME_OF
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
    notes += star_notes(results["curve_tests"], results["tests_note"])
    if any(task["paper"] for task in tasks):
        notes.append(PAPER_NOTE)
    if any(key.endswith("_blind") for task in tasks for key in task["representations"]):
        notes.append(BLIND_NOTE)
    panels = [_panel(task, results["curve_tests"][key]) for key, task in results["tasks"].items()]
    return LineChart("Accuracy over principal components", panels, notes)


def star_notes(tests: Mapping[str, Values], note: str = "") -> list[str]:
    """Return what the asterisks mean, nothing without any; ``note``: words behind the rule."""
    each = [test for by_name in tests.values() for test in by_name.values()]
    rules = dict.fromkeys(test["rule"] for test in each if any(test["stars"]))
    if not rules:
        return []
    said = f"{' / '.join(rules)}. {note}".rstrip()
    return [f"Asterisks against Original, grey where Original is better: {said}"]


def asterisks(test: Values | None) -> dict[str, Any]:
    """Return the asterisks of a curve and where they are grey, as members of a series."""
    if test is None:
        return {}
    return {"stars": test["stars"], "worse": [(effect or 0.0) < 0 for effect in test["effect"]]}


def accuracy_panel(
    title: str, series: Sequence[ChartSeries], last: float, chance: float
) -> LinePanel:
    """Return a panel of accuracies in % over 1 to ``last`` components; ``chance``: a share."""
    return LinePanel(
        title,
        series,
        "principal components",
        "accuracy (%)",
        (0.0, last + 1.0),
        (0.0, 100.0),
        x_name="components",
        level=(100 * chance, f"chance {100 * chance:.3g} %"),
    )


def _panel(task: Values, tests: Values) -> LinePanel:
    title = f"{task['figure']}  {task['title']}".strip()
    series = [_series(task, key, tests.get(key)) for key in _ordered(task)]
    last = max(task["k_max"], published.K_MAX if task["paper"] else 1)
    return accuracy_panel(title, series, last, task["chance"])


def _ordered(task: Values) -> list[str]:
    return [key for key in NAME_OF if key in task["representations"]]


def _series(task: Values, key: str, test: Values | None) -> ChartSeries:
    curve = task["representations"][key]
    mean = [100 * share for share in curve["mean"]]
    return ChartSeries(
        key,
        NAME_OF[key],
        STYLES[key],
        [float(k) for k in range(1, len(mean) + 1)],
        mean,
        None if curve["sd"] is None else [100 * share for share in curve["sd"]],
        marks=_paper_mark(task, key),
        **asterisks(None if key.endswith("_blind") else test),
    )


def _paper_mark(task: Values, key: str) -> list[ChartMark]:
    if key not in task["paper"]:
        return []
    mean, sd = task["paper"][key]
    return [ChartMark(float(published.K_MAX), mean, f"the paper {mean:.2f} ± {sd:.2f} %")]
