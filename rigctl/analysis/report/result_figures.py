"""Figure 3 and the confusion matrices of a report, from the values of its ``results.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis import published
from rigctl.analysis.comparisons import NAME_OF
from rigctl.analysis.report.figure import Figure, Matrix, Panel, PublishedValue, Series

Values = Mapping[str, Any]

STYLES = {
    "original": "ink",
    "speed": "blue",
    "force": "red",
    "speed_force": "green",
    "force_blind": "red",
    "speed_force_blind": "green",
    "divided": "violet",
    "speed_divided": "violet",
    "calibrated": "brown",
    "speed_calibrated": "brown",
    "loadcell": "teal",
    "speed_loadcell": "teal",
}
"""The paper's colours, and others for what the paper does not have."""
DASHED = ("force_blind", "speed_force_blind", "divided", "calibrated", "loadcell")
BLIND = "_blind"
PAPER_NOTE = (
    f"Diamonds: the paper's Table 1 with {published.K_MAX} components, in the colour of its curve."
)
BLIND_NOTE = (
    "Force Scaled curves use the C of the true texture, which a dashed, texture-blind one does not."
)
GAIN_NOTE = (
    "Divided and Calibrated know neither texture nor force: their gain is of all taxels' readings, "
    "Load Cell's of the force that was measured."
)
CONFUSION_TASKS = (
    "untrained-both",
    "leave-speed-out",
    "leave-force-out",
    "textures",
    "groups",
    "leave-mount-out",
)
"""The task whose matrices are shown is the first of these; S1 to S4 are of the first one."""


def accuracy_figure(results: Values) -> Figure:
    """Return Figure 3 of a report: accuracy over components, a panel for each task."""
    tasks = results["tasks"].values()
    n = results["settings"]["iterations"]
    bars = "bars: standard deviation" if n > 1 else "one draw, no spread"
    notes = [f"Mean of {n} draw{'s' if n > 1 else ''}; {bars}."]
    notes += star_notes(results["curve_tests"], results["tests_note"])
    if any(task["paper"] for task in tasks):
        notes.append(PAPER_NOTE)
    if any(key.endswith(BLIND) for task in tasks for key in task["representations"]):
        notes.append(BLIND_NOTE)
    notes.append(GAIN_NOTE)
    panels = [_panel(task, results["curve_tests"][key]) for key, task in results["tasks"].items()]
    return Figure("Accuracy over principal components", panels, notes)


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


def accuracy_panel(title: str, series: Sequence[Series], chance: float) -> Panel:
    """Return a panel of accuracies in % over components up to the last point.

    ``chance``: a share.
    """
    points = (x for one in series for x in (*one.x, *(value.x for value in one.published)))
    last = max(points, default=1)
    return Panel(
        title,
        series,
        "principal components",
        "accuracy (%)",
        (0.0, last + 1.0),
        (0.0, 100.0),
        x_name="components",
        level=(100 * chance, f"chance {100 * chance:.3g} %"),
    )


def percent(shares: Sequence[float]) -> list[float]:
    """Return shares in per cent."""
    return [100 * share for share in shares]


def _panel(task: Values, tests: Values) -> Panel:
    title = f"{task['figure']}  {task['title']}".strip()
    ordered = [key for key in NAME_OF if key in task["representations"]]
    series = [_series(task, key, tests.get(key)) for key in ordered]
    return accuracy_panel(title, series, task["chance"])


def _series(task: Values, key: str, test: Values | None) -> Series:
    curve, blind = task["representations"][key], key.endswith(BLIND)
    return Series(
        NAME_OF[key],
        STYLES[key],
        range(1, len(curve["mean"]) + 1),
        percent(curve["mean"]),
        None if curve["sd"] is None else percent(curve["sd"]),
        published=_published(task, key),
        dashed=key in DASHED,
        **asterisks(None if blind else test),
    )


def _published(task: Values, key: str) -> list[PublishedValue]:
    if key not in task["paper"]:
        return []
    mean, sd = task["paper"][key]
    words = f"the paper {mean:.2f} ± {sd:.2f} % with {published.K_MAX} components"
    return [PublishedValue(published.K_MAX, mean, words)]


def confusion_figures(results: Values, *, blind: bool = False) -> list[Figure]:
    """Return the matrices of each task, the one of the paper's S1 to S4 or its stand-in first.

    ``blind``: those with a texture-blind C too.
    """
    tasks = results["tasks"]
    first = [key for key in CONFUSION_TASKS if key in tasks][:1]
    order = [*first, *(key for key in tasks if key not in first)]
    return [_confusion_figure(tasks[key], blind=blind) for key in order]


def _confusion_figure(task: Values, *, blind: bool) -> Figure:
    title = f"{task['title']}: confusion with {task['shown_components']} components"
    keys = [
        key for key in NAME_OF if key in task["representations"] and (blind or BLIND not in key)
    ]
    matrices = [_matrix(task, key) for key in keys]
    return Figure(title, matrices, ["All draws together."], columns=2)


def _matrix(task: Values, key: str) -> Matrix:
    curve, paper = task["representations"][key], task["confusion_shares"][key]["paper"]
    tested = [sum(row) for row in curve["confusion"]]
    each = f"{max(tested):,}" if min(tested) == max(tested) else f"{min(tested):,}–{max(tested):,}"
    knows = "; C knew the texture" if curve["c_knows_the_label"] else ""
    subtitle = [f"the paper's {paper['figure']}: {paper['percent']:.2f} %"] if paper else []
    subtitle.append(f"% of {each} trials a row{knows}")
    return Matrix(NAME_OF[key], subtitle, task["classes"], curve["confusion"])
