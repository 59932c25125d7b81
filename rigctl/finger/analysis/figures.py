"""Figures 4B, 4C and S5, and what the answers are worth, from the values of ``results.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.figure import (
    COLOURS,
    Bars,
    Figure,
    Matrix,
    Panel,
    PublishedValue,
    Series,
)
from rigctl.analysis.report.figures import TEXT, new_figure, save_figure
from rigctl.analysis.report.result_figures import accuracy_panel, asterisks, percent, star_notes
from rigctl.finger.published import DEPLOYED
from rigctl.finger.values import VelocityProfile

Floats = NDArray[np.float64]
Values = Mapping[str, Any]

TASK_COLOURS = {"new-session": "green", "untrained-profiles": "green"}
"""The paper's: green for what is new to the classifier, blue for the rest."""
LIGHTER = "light-"
"""Of the paper's curves, those without speed scaling are lighter."""
KIND_COLOURS = {
    "Original": "ink",
    "Speed Scaled": "blue",
    "Divided": "violet",
    "Speed Scaled and Divided": "green",
    "Calibrated": "brown",
    "Speed Scaled and Calibrated": "red",
}
ORIGINAL = "Original"
PROFILE_ORDER = tuple(map(str, VelocityProfile))
PEAKS_NOTE = "Diamonds: the paper's peaks, in the colour of their curve."
LATENCY_ROOM = 1.3
"""The axis of a latency ends this far beyond the largest one."""
ROOM = 1.05
"""An axis ends a little beyond its largest value."""


def accuracy_figures(results: Values, titles: Mapping[str, str]) -> list[Figure]:
    """Return the paper's figures of these tasks; ``titles``: by figure, such as ``Fig. 4B``."""
    charts = []
    for figure, title in titles.items():
        tasks = {key: one for key, one in results["tasks"].items() if one["figure"] == figure}
        if tasks:
            tests = {key: results["curve_tests"][key] for key in tasks}
            panel = _accuracy_panel(title, tasks, tests)
            charts.append(Figure(title, [panel], _notes(tasks, tests)))
    return charts


def _accuracy_panel(title: str, tasks: Mapping[str, Values], tests: Mapping[str, Values]) -> Panel:
    series = [
        _accuracy_series(key, task, kind, tests[key].get(kind))
        for key, task in tasks.items()
        for kind in task["paper"]["accuracy"]
    ]
    return accuracy_panel(title, series, next(iter(tasks.values()))["chance"])


def _accuracy_series(key: str, task: Values, kind: str, test: Values | None) -> Series:
    curve, error = task["curves"][kind], task["curves"][kind]["standard_error"]
    return Series(
        f"{task['title']}: {kind}",
        f"{LIGHTER if kind == ORIGINAL else ''}{TASK_COLOURS.get(key, 'blue')}",
        range(1, len(curve["mean"]) + 1),
        percent(curve["mean"]),
        None if error is None else percent(error),
        published=[_published(task["paper"]["accuracy"][kind], task["k_max"])],
        **asterisks(test),
    )


def _published(value: Values, k_max: int) -> PublishedValue:
    """Return the paper's value at its components, a saturation at the last component."""
    quoted, at = value["percent"], value["components"]
    if at is None:
        return PublishedValue(k_max, quoted, f"the paper: about {quoted:g} % where it saturates")
    words = f"the paper's peak: {quoted:g} % with {at} components"
    return PublishedValue(at, quoted, words)


def _notes(tasks: Mapping[str, Values], tests: Mapping[str, Values]) -> list[str]:
    quoted = [value for one in tasks.values() for value in one["paper"]["accuracy"].values()]
    errors = [one["standard_error"] for task in tasks.values() for one in task["curves"].values()]
    one = next(iter(tasks.values()))
    counted = f"{one['n']} draws"
    if DEPLOYED.key in tasks:
        counted = f"{one['n'] * one['tested_per_draw']} trials"
    if one["n_of_runs"]:
        each = ", ".join(f"{n} {kind}" for kind, n in one["n_of_runs"].items())
        counted = f"{each} trials, in runs of their own"
    bars = "one draw, no spread" if None in errors else "bars: standard error"
    notes = [f"n = {counted}; {bars}."]
    notes += [*star_notes(tests), PEAKS_NOTE]
    if any(value["components"] is None for value in quoted):
        notes.append("The paper's saturations are at the last component.")
    return notes


def gain_figure(results: Values) -> Figure:
    """Return the accuracy of every representation: a panel for each task."""
    panels = [
        accuracy_panel(
            f"{task['figure']}, {task['title'].lower()}",
            [
                Series(kind, KIND_COLOURS[kind], range(1, task["k_max"] + 1), percent(one["mean"]))
                for kind, one in task["curves"].items()
            ],
            task["chance"],
        )
        for task in results["tasks"].values()
    ]
    knows = "; ".join(f"{kind}: {what}" for kind, what in results["knows"].items())
    note = f"What the scaling of the force knows beside the readings: {knows}."
    return Figure("Force scaling without labels", panels, [note], columns=3)


def answer_figures(results: Values) -> list[Figure]:
    """Return the confusion of the textures, and the accuracy by velocity profile, of Figure S5."""
    answers = results["answers"]
    matrices = [
        Matrix(one["kind"], [f"{one['components']} components"], one["textures"], one["confusion"])
        for one in answers
    ]
    confusion = Figure("Figure S5: confusion of the textures", matrices, ["% of a row."], columns=2)
    names = [name for name in PROFILE_ORDER if all(name in one["tested"] for one in answers)]
    series = []
    for one in answers:
        shares = [100 * one["right"][name] / one["tested"][name] for name in names]
        ends = [(100 * low, 100 * high) for low, high in (one["interval"][name] for name in names)]
        series.append(
            Series(one["kind"], KIND_COLOURS[one["kind"]], range(len(names)), shares, ends)
        )
    bars = Bars("", names, series, "accuracy (%)", (0.0, 100.0))
    note = f"{answers[0]['components']} components; bars: 95 % Wilson intervals of the trials."
    return [confusion, Figure("Figure S5: accuracy by velocity profile", [bars], [note])]


def evidence_figure(results: Values) -> Figure:
    """Return accuracy against millimetres and seconds of evidence."""
    components = results["settings"]["analysis"]["finger"]["components"]
    note = f"New sessions, {components} components."
    chance = 100 * next(iter(results["tasks"].values()))["chance"]
    panels = [
        Panel(
            title,
            [
                Series(one["kind"], KIND_COLOURS[one["kind"]], one[x], y)
                for one in results["evidence"]
                for y in [percent(one[by])]
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
    return Figure("Accuracy against evidence", panels, [note])


def promises_figure(results: Values) -> Figure:
    """Return coverage and size of the sets, and calls of unknown plates, by window."""
    coverage, novelty = results["coverage"], results["novelty"]
    sizes = [_by_window(one["kind"], one["mean_size"]) for one in coverage]
    promised = 100 * coverage[0]["promised"]
    panels = [
        _window_panel(
            "Coverage",
            [_by_window(one["kind"], percent(one["coverage"])) for one in coverage],
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
        calls = [_by_window(one["kind"], percent(one["detected"])) for one in novelty]
        calls += [
            _by_window(one["kind"], percent(one["false_alarms"]), trained=True) for one in novelty
        ]
        panels.append(_window_panel("Unknown plates", calls, "scans called unknown (%)"))
    return Figure("How sure an answer is", panels, ["Held-out trials."])


def _by_window(kind: str, y: Sequence[float], *, trained: bool = False) -> Series:
    name = f"{kind}, a trained plate" if trained else kind
    return Series(name, KIND_COLOURS[kind], range(1, len(y) + 1), y, dashed=trained)


def _window_panel(
    title: str,
    series: list[Series],
    label: str,
    top: float = 100.0,
    unit: str = "%",
    level: tuple[float, str] | None = None,
) -> Panel:
    last = max(max(one.x) for one in series)
    return Panel(
        title, series, "windows of evidence", label, (0.0, last + 0.5), (0.0, top),
        x_name="window", unit=unit, level=level,
    )  # fmt: skip


def draw_latencies(latencies: Mapping[str, Floats], origin: str, stem: Path) -> Path:
    """Draw histograms of the latencies, a panel for each kind; return the PNG's path."""
    figure, panels = new_figure((11, 3.8), 1, len(latencies), squeeze=False)
    for axes, (kind, ms) in zip(panels.flat, latencies.items(), strict=True):
        p99, p999 = np.percentile(ms, [99.0, 99.9])
        edges = np.linspace(0.0, LATENCY_ROOM * max(float(ms.max()), 0.1), 51)
        axes.hist(ms, bins=edges.tolist(), color=COLOURS["blue"])
        axes.set_yscale("log")
        axes.set(xlabel="latency (ms)", ylabel="number", xlim=(0, edges[-1]), ylim=(0.5, None))
        for value, dashes in ((p99, "--"), (p999, ":")):
            axes.axvline(value, color=TEXT, lw=1, ls=dashes)
        title = f"{kind}, n = {len(ms):,}: p99 {p99:.2f} ms (dashed), p99.9 {p999:.2f} ms (dotted)"
        axes.set_title(title, size=9, loc="left", color=TEXT)
    return save_figure(figure, stem, "Latency from the sending of a velocity", origin)
