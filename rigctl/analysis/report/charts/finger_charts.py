"""Figures 4B, 4C and S5 for the page, and what the answers are worth, from ``results.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.report.charts.accuracy_charts import accuracy_panel, asterisks, star_notes
from rigctl.analysis.report.charts.line_chart import (
    ChartMark,
    ChartSeries,
    LineChart,
    LinePanel,
)

Values = Mapping[str, Any]

COLOURS = {"new-session": "green", "untrained-profiles": "green"}
"""The paper's: green for what is new to the classifier, blue for the rest."""
KIND_STYLES = {"Original": "ink", "Speed Scaled": "blue"}
ORIGINAL = "Original"
PEAKS_NOTE = "Diamonds: the paper's peaks, filled for Speed Scaled, hollow for Original."
ROOM = 1.05
"""An axis ends a little beyond its largest value."""


def accuracy_charts(results: Values, titles: Mapping[str, str]) -> list[LineChart]:
    """Return a chart for each figure of the paper; ``titles``: by figure, such as ``Fig. 4B``."""
    charts = []
    for figure, title in titles.items():
        tasks = {key: one for key, one in results["tasks"].items() if one["figure"] == figure}
        if tasks:
            tests = {key: results["curve_tests"][key] for key in tasks}
            panel = _accuracy_panel(title, tasks, tests)
            charts.append(LineChart(title, [panel], _notes(tasks, tests)))
    return charts


def _accuracy_panel(
    title: str, tasks: Mapping[str, Values], tests: Mapping[str, Values]
) -> LinePanel:
    series = [
        _accuracy_series(key, task, kind, tests[key].get(kind))
        for key, task in tasks.items()
        for kind in task["curves"]
    ]
    last = max(max([*one.x, *(mark.x for mark in one.marks)]) for one in series)
    return accuracy_panel(title, series, last, next(iter(tasks.values()))["chance"])


def _accuracy_series(key: str, task: Values, kind: str, test: Values | None) -> ChartSeries:
    curve, error = task["curves"][kind], task["curves"][kind]["standard_error"]
    return ChartSeries(
        f"{key} {kind}",
        f"{task['title']}: {kind}",
        COLOURS.get(key, "blue") + (" dashed" if kind == ORIGINAL else ""),
        [float(k) for k in range(1, len(curve["mean"]) + 1)],
        _percent(curve["mean"]),
        None if error is None else _percent(error),
        marks=[_quoted(task["paper"]["accuracy"][kind], task["k_max"])],
        **asterisks(test),
    )


def _quoted(value: Values, k_max: int) -> ChartMark:
    """Return the paper's value at its components, a saturation at the last component."""
    if value["components"] is None:
        return ChartMark(float(k_max), value["percent"], f"the paper: about {value['percent']:g} %")
    return ChartMark(
        float(value["components"]), value["percent"], f"the paper's peak: {value['percent']:g} %"
    )


def _notes(tasks: Mapping[str, Values], tests: Mapping[str, Values]) -> list[str]:
    quoted = [value for one in tasks.values() for value in one["paper"]["accuracy"].values()]
    errors = [one["standard_error"] for task in tasks.values() for one in task["curves"].values()]
    notes = ["One draw, no spread." if None in errors else "Bars: standard error."]
    notes += [*star_notes(tests), PEAKS_NOTE]
    if any(value["components"] is None for value in quoted):
        notes.append("The paper's saturations are at the last component.")
    return notes


def evidence_chart(results: Values) -> LineChart:
    """Return accuracy against millimetres and seconds of evidence."""
    components = results["settings"]["analysis"]["finger"]["components"]
    note = f"New sessions, {components} components."
    chance = 100 * next(iter(results["tasks"].values()))["chance"]
    panels = [
        LinePanel(
            title,
            [
                ChartSeries(one["kind"], one["kind"], KIND_STYLES[one["kind"]], one[x], y)
                for one in results["evidence"]
                for y in [_percent(one[by])]
            ],
            label,
            "accuracy (%)",
            (0.0, ROOM * max(max(one[x]) for one in results["evidence"])),
            (0.0, 100.0),
            x_name=unit,
            level=(chance, f"chance {chance:.3g} %"),
        )
        for title, x, by, label, unit in (
            ("By way", "at_mm", "by_mm", "way over the plate (mm)", "mm"),
            ("By time", "at_s", "by_s", "time since the first mark (s)", "s"),
        )
    ]
    return LineChart("Accuracy against evidence", panels, [note])


def promises_chart(results: Values) -> LineChart:
    """Return coverage and size of the sets, and calls of unknown plates, by window."""
    coverage, novelty = results["coverage"], results["novelty"]
    sizes = [_by_window(one["kind"], one["mean_size"]) for one in coverage]
    promised = 100 * coverage[0]["promised"]
    panels = [
        _window_panel(
            "Coverage",
            [_by_window(one["kind"], _percent(one["coverage"])) for one in coverage],
            "sets that hold the texture (%)",
            level=(promised, f"promised {promised:.0f} %"),
        ),
        _window_panel(
            "Size of the sets",
            sizes,
            "mean number of textures",
            top=ROOM * max(max(one.y) for one in sizes),
            unit="textures",
        ),
    ]
    if novelty:
        calls = [_by_window(one["kind"], _percent(one["detected"])) for one in novelty]
        calls += [
            _by_window(one["kind"], _percent(one["false_alarms"]), trained=True) for one in novelty
        ]
        panels.append(_window_panel("Unknown plates", calls, "scans called unknown (%)"))
    return LineChart("How sure an answer is", panels, ["Held-out trials."])


def _by_window(kind: str, y: Sequence[float], *, trained: bool = False) -> ChartSeries:
    windows = [float(n) for n in range(1, len(y) + 1)]
    if trained:
        name, style = f"{kind}, a trained plate", f"{KIND_STYLES[kind]} dashed"
        return ChartSeries(name, name, style, windows, y)
    return ChartSeries(kind, kind, KIND_STYLES[kind], windows, y)


def _window_panel(
    title: str,
    series: list[ChartSeries],
    label: str,
    top: float = 100.0,
    unit: str = "%",
    level: tuple[float, str] | None = None,
) -> LinePanel:
    last = max(max(one.x) for one in series)
    return LinePanel(
        title, series, "windows of evidence", label, (0.0, last + 0.5), (0.0, top),
        x_name="window", unit=unit, level=level,
    )  # fmt: skip


def _percent(shares: Sequence[float]) -> list[float]:
    return [100 * share for share in shares]
