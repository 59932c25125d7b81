"""The report's figures: the curves of Figure 3 and confusion matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rigctl.analysis import published
from rigctl.analysis.comparisons import curve_differences
from rigctl.analysis.report.figures import (
    FAINT,
    MUTED,
    TEXT,
    new_figure,
    plot_matrix,
    save_figure,
)
from rigctl.analysis.statistics import Difference, describe_rule
from rigctl.analysis.tasks import Curve, TaskResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
MAX_ANNOTATED_CLASSES = 16
MIN_WIDTH_IN = 8.2
"""Room for the title, and for the legend beside the origin of the data."""
ASTERISK = (6, 2, 0)
"""A marker with six rays."""
ASTERISK_PERCENT, ROW_PERCENT = 4.5, 12.0
"""Distance of two asterisks above each other, and of the rows of two representations."""


class CurveStyle(NamedTuple):
    """The line style of a representation: the paper's colours; dashed where C is texture-blind."""

    colour: str
    dashes: Any
    width: float


STYLES = {
    "original": CurveStyle("#111111", "-", 1.5),
    "force": CurveStyle("#c8102e", "-", 1.5),
    "speed": CurveStyle("#1f4fd1", "-", 1.5),
    "speed_force": CurveStyle("#1a8a34", "-", 1.5),
    "force_blind": CurveStyle("#c8102e", (0, (3, 2)), 1.0),
    "speed_force_blind": CurveStyle("#1a8a34", (0, (3, 2)), 1.0),
}


def draw_curves(results: Sequence[TaskResult], origin: str, stem: Path) -> Path:
    """Draw accuracy over components, a panel for each task, as SVG and PNG; return the PNG."""
    columns = min(COLUMNS, len(results))
    rows = ceil(len(results) / columns)
    size = (max(MIN_WIDTH_IN, 3.9 * columns + 0.4), 3.5 * rows + 1.5)
    figure, panels = new_figure(size, rows, columns, squeeze=False)
    for result, axes in zip(results, panels.flat, strict=False):
        _plot_curves(axes, result)
    for axes in panels.flat[len(results) :]:
        axes.set_axis_off()
    _add_legend(figure, panels.flat[0], results)
    iterations = len(results[0].curves[0].accuracy)
    bars = "bars: standard deviation (n − 1)" if iterations > 1 else "one draw, no spread"
    title = f"Classification accuracy: mean of {iterations} draws; {bars}"
    return save_figure(figure, stem, title, origin)


def draw_confusion(result: TaskResult, origin: str, stem: Path) -> Path:
    """Draw confusion matrices, a panel for each representation (the paper's S1 to S4)."""
    curves = [c for c in result.curves if c.representation.force != "blind"]
    columns = min(2, len(curves))
    rows = ceil(len(curves) / columns)
    figure, panels = new_figure((5.2 * columns, 5.0 * rows + 0.8), rows, columns, squeeze=False)
    for axes, curve in zip(panels.flat, curves, strict=False):
        _plot_confusion(axes, curve, result)
    for axes in panels.flat[len(curves) :]:
        axes.set_axis_off()
    title = f"{result.task.title}: confusion with {result.shown_components} components"
    return save_figure(figure, stem, title, origin)


def _plot_curves(axes: Axes, result: TaskResult) -> None:
    k = np.arange(1, result.k_max + 1)
    for curve in result.curves:
        style = STYLES[curve.representation.key]
        sd = curve.sd
        axes.errorbar(
            k,
            100 * curve.mean,
            None if sd is None else 100 * sd,
            color=style.colour,
            ls=style.dashes,
            lw=style.width,
            elinewidth=0.7,
            label=curve.representation.name,
        )
    top = _plot_asterisks(axes, curve_differences(result))
    axes.axhline(100 * result.chance, color=MUTED, lw=1, ls=":")
    chance = f"chance {100 * result.chance:.3g} %"
    axes.set_title(chance, size=7.5, loc="right", color=MUTED)
    axes.set(ylim=(0, top), xlim=(0.5, k[-1] + 0.5), yticks=range(0, 101, 20))
    axes.set(xlabel="principal components", ylabel="accuracy (%)")
    named = f"{result.task.figure}  {result.task.title}".strip()
    axes.set_title(named, size=9.5, loc="left", color=TEXT)
    axes.grid(axis="y", color=FAINT, lw=0.6)


def _plot_asterisks(axes: Axes, tests: Mapping[str, Sequence[Difference]]) -> float:
    """Mark each number of components at which a curve differs from Original; return the top in %.

    One row above 100 % for each representation of the paper, in its colour: filled where it is
    better than Original, grey where Original is better.
    """
    base = 105.0
    for key in [key for key in reversed(STYLES) if not key.endswith("_blind")]:
        marked = [(k, one) for k, one in enumerate(tests.get(key, ()), start=1) if one.stars]
        for better, colour in ((True, STYLES[key].colour), (False, MUTED)):
            places = [
                (k, base + row * ASTERISK_PERCENT)
                for k, one in marked
                if ((one.effect or 0.0) > 0) is better
                for row in range(len(one.stars))
            ]
            if places:
                x, y = zip(*places, strict=True)
                axes.plot(x, y, ls="", marker=ASTERISK, ms=3.2, mew=0.5, color=colour)
        base += ROW_PERCENT if marked else 0.0
    return max(103.0, base)


def _add_legend(figure: Figure, axes: Axes, results: Sequence[TaskResult]) -> None:
    """Add the names of the curves, below what the asterisks mean if there are any tests."""
    lines, names = axes.get_legend_handles_labels()
    columns = 3 if len(results) >= COLUMNS else 2
    legend = figure.legend(
        lines, names, loc="outside lower right", ncols=columns, frameon=False, fontsize=9
    )
    tests = (each for result in results for each in curve_differences(result).values())
    first = next((one for each in tests for one in each if one.p is not None), None)
    if first is not None:
        rule = describe_rule(first.rule, first.test)
        legend.set_title(
            f"Asterisks against Original: {rule};\n"
            "grey where Original is better. The paper has none in Fig. 3."
        )
        legend.set_alignment("left")
        legend.get_title().set(color=MUTED, size=8.5)


def _plot_confusion(axes: Axes, curve: Curve, result: TaskResult) -> None:
    tested = curve.confusion.sum(axis=1)
    annotated = len(result.classes) <= MAX_ANNOTATED_CLASSES

    def percent(count: int, share: float) -> str:
        return f"{100 * share:.0f}" if annotated and share >= 0.005 else ""

    size = 9 if len(result.classes) <= 8 else 6
    plot_matrix(axes, curve.confusion, result.classes, percent, size=size)
    axes.set(xlabel="predicted", ylabel="true")
    right = np.trace(curve.confusion) / max(int(curve.confusion.sum()), 1)
    note = "; C knew the texture" if curve.representation.sees_labels else ""
    fewest, most = int(tested.min()), int(tested.max())
    trials = f"{most}" if fewest == most else f"{fewest}–{most}"
    paper = _caption_share(curve, result)
    title = f"{curve.representation.name}: {right:.2%}{paper}\n% of {trials} trials a row{note}"
    axes.set_title(title, size=9, loc="left", color=TEXT)


def _caption_share(curve: Curve, result: TaskResult) -> str:
    """Return the share that the paper's caption states for this matrix, empty if it has none."""
    key = curve.representation.key
    if result.task.key != published.CONFUSION_TASK or key not in published.CONFUSION_PERCENT:
        return ""
    figure, percent = published.CONFUSION_PERCENT[key]
    return f" (the paper's {figure}: {percent:.2f} %)"
