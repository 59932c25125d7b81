"""The report's figures: the curves of Figure 3, confusion matrices, one taxel as in Figure 2C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.paper.tasks import Curve, TaskResult
from rigctl.analysis.report.figures import (
    FAINT,
    MUTED,
    TEXT,
    new_figure,
    plot_matrix,
    save_figure,
)
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 3
MAX_ANNOTATED_CLASSES = 16


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


@dataclass(frozen=True, slots=True)
class TaxelData:
    """The contents of Figure 2C: one taxel of one trial.

    ``reading``: float64 (n,), 0–1. ``membrane_mv``: float64 (n, 2), SA and RA. ``spikes``:
    int32 sample indices of SA and of RA.
    """

    title: str
    origin: str
    reading: NDArray[np.float64]
    membrane_mv: NDArray[np.float64]
    spikes: tuple[NDArray[np.int32], NDArray[np.int32]]
    shown_s: float = 1.0


def draw_curves(results: Sequence[TaskResult], origin: str, stem: Path) -> Path:
    """Draw accuracy over components, a panel for each task, as SVG and PNG; return the PNG."""
    columns = min(COLUMNS, len(results))
    rows = ceil(len(results) / columns)
    size = (3.9 * columns + 0.4, 3.1 * rows + 1.1)
    figure, panels = new_figure(size, rows, columns, squeeze=False)
    for result, axes in zip(results, panels.flat, strict=False):
        _plot_curves(axes, result)
    for axes in panels.flat[len(results) :]:
        axes.set_axis_off()
    lines, names = panels.flat[0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower right", ncols=columns, frameon=False, fontsize=9)
    iterations = len(results[0].curves[0].accuracy)
    bars = "bars: standard deviation" if iterations > 1 else "one draw, no spread"
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


def draw_taxel(data: TaxelData, stem: Path) -> Path:
    """Draw one taxel's reading, the voltages of both neurons and their spikes."""
    heights = [2.2, 1.6, 0.5, 1.6, 0.5]
    figure, rows = new_figure((9.5, 5.6), 5, 1, sharex=True, height_ratios=heights)
    time_s = np.arange(len(data.reading)) / SAMPLE_RATE_HZ
    inside = time_s < data.shown_s
    rows[0].plot(time_s[inside], data.reading[inside], color=TEXT, lw=1)
    rows[0].set_ylabel("reading\n(0–1)")
    colours = (STYLES["speed"].colour, "#c24e00")
    for channel, (name, colour) in enumerate(zip(("SA", "RA"), colours, strict=True)):
        voltage, ticks = rows[1 + 2 * channel], rows[2 + 2 * channel]
        voltage.plot(time_s[inside], data.membrane_mv[inside, channel], color=colour, lw=0.7)
        voltage.set_ylabel(f"{name} v\n(mV)")
        at = data.spikes[channel] / SAMPLE_RATE_HZ
        at = at[at < data.shown_s]
        ticks.vlines(at, 0, 1, color=colour, lw=0.9)
        ticks.set(ylim=(-0.1, 1.1), yticks=[])
        ticks.set_ylabel("spikes", rotation=0, ha="right", va="center", size=8, color=MUTED)
    figure.align_ylabels(rows)
    rows[-1].set_xlim(0, min(data.shown_s, len(data.reading) / SAMPLE_RATE_HZ))
    rows[-1].set_xlabel("time since the trial window opened (s)")
    return save_figure(figure, stem, data.title, data.origin)


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
    axes.axhline(100 * result.chance, color=MUTED, lw=1, ls=":")
    chance = f"chance {100 * result.chance:.3g} %"
    axes.set_title(chance, size=7.5, loc="right", color=MUTED)
    axes.set(ylim=(0, 103), xlim=(0.5, k[-1] + 0.5))
    axes.set(xlabel="principal components", ylabel="accuracy (%)")
    named = f"{result.task.figure}  {result.task.title}".strip()
    axes.set_title(named, size=9.5, loc="left", color=TEXT)
    axes.grid(axis="y", color=FAINT, lw=0.6)


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
    title = f"{curve.representation.name}: {right:.1%}\n% of {trials} trials a row{note}"
    axes.set_title(title, size=9, loc="left", color=TEXT)
