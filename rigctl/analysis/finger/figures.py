"""Figures 4B, 4C and S5 with the paper's quoted values, and the figures beyond the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.finger.evaluation import EvidenceCurve, NoveltyResult, SetCoverage
from rigctl.analysis.finger.published import (
    DEPLOYED,
    NEW_SESSION,
    SAME_SESSION,
    TRAINED,
    UNTRAINED,
    QuotedAccuracy,
)
from rigctl.analysis.finger.scans import KINDS, ScanKind
from rigctl.analysis.finger.tasks import FingerResult
from rigctl.analysis.report.figures import FAINT, MUTED, TEXT, new_figure, save_figure
from rigctl.analysis.statistics import describe_rule

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Floats = NDArray[np.float64]
BLUE, GREEN = "#1f4fd1", "#1a8a34"
COLOURS = {
    SAME_SESSION.key: BLUE,
    NEW_SESSION.key: GREEN,
    TRAINED.key: BLUE,
    UNTRAINED.key: GREEN,
    DEPLOYED.key: BLUE,
}
"""The paper's colours of its lines."""
KIND_COLOURS = {ScanKind.ORIGINAL: TEXT, ScanKind.SPEED_SCALED: BLUE}
LATENCY_ROOM = 1.3
"""The axis of a latency ends this far beyond the largest one."""
ROW_PERCENT = 8.0
"""Height of a row of asterisks above 100 %."""
SATURATION_ROOM = 0.11
"""Room for the paper's saturations right of the curves, as a share of the components."""


def draw_accuracies(results: Sequence[FingerResult], title: str, origin: str, stem: Path) -> Path:
    """Draw accuracy over components with standard errors and asterisks; return the PNG's path.

    Solid: Speed Scaled; dashed: Original. Diamonds and short lines: the paper's quoted values.
    """
    figure, axes = new_figure((11, 6.2), 1, 1)
    for row, result in enumerate(results):
        _plot_curves(axes, result)
        _plot_stars(axes, result, 103.0 + ROW_PERCENT * (len(results) - 1 - row))
    quoted = [value for result in results for value in result.task.quoted]
    k_max = max(*(result.k_max for result in results), *(value.components or 0 for value in quoted))
    chance = 100 * results[0].chance
    axes.axhline(chance, color=MUTED, lw=1, ls=":")
    axes.text(0.3, chance - 1, f"chance {chance:.0f} %", va="top", size=8, color=MUTED)
    room = SATURATION_ROOM if any(value.components is None for value in quoted) else 0.0
    axes.set(xlim=(0, k_max * (1.0 + room) + 1), ylim=(0, 103.0 + ROW_PERCENT * len(results)))
    axes.set_yticks(range(0, 101, 20))
    axes.set(xlabel="principal components", ylabel="accuracy (%)")
    axes.grid(axis="y", color=FAINT, lw=0.6)
    axes.set_title(_note(results[0]), size=8.5, color=MUTED, loc="left")
    _mark_legend(axes, quoted)
    # Below chance there is room in every figure.
    axes.legend(loc="lower center", ncols=3, frameon=False, fontsize=8.5)
    return save_figure(figure, stem, title, origin)


def draw_evidence(
    curves: Sequence[EvidenceCurve], components: int, chance: float, origin: str, stem: Path
) -> Path:
    """Draw accuracy against millimetres and seconds of evidence; return the PNG's path.

    ``components``: most principal components of the classifier.
    """
    figure, (way, time) = new_figure((11, 4.6), 1, 2, sharey=True)
    for curve in curves:
        style: dict[str, Any] = {"color": KIND_COLOURS[curve.kind], "label": curve.kind.value}
        way.plot(curve.at_mm, 100 * curve.by_mm, marker="o", ms=3.5, lw=1.6, **style)
        time.plot(curve.at_s, 100 * curve.by_s, marker="o", ms=3, lw=1.6, **style)
    for axes in (way, time):
        axes.axhline(100 * chance, color=MUTED, lw=1, ls=":")
        axes.set(ylim=(0, 103), xlim=(0, None))
        axes.grid(axis="y", color=FAINT, lw=0.6)
    way.set(xlabel="way over the plate (mm)", ylabel="accuracy (%)")
    time.set(xlabel="time since the first mark (s)")
    way.legend(frameon=False, loc="lower right")
    way.text(1, 100 * chance + 1.5, f"chance {chance:.0%}", size=8, color=MUTED)
    title = f"Accuracy against evidence, new sessions, {components} components"
    return save_figure(figure, stem, title, origin)


def draw_promises(
    coverage: Sequence[SetCoverage], novelty: Sequence[NoveltyResult], origin: str, stem: Path
) -> Path:
    """Draw coverage and size of the sets, and calls of unknown plates; return the PNG's path."""
    figure, (held, size, calls) = new_figure((13, 4.6), 1, 3)
    for one in coverage:
        style: dict[str, Any] = {"color": KIND_COLOURS[one.kind], "lw": 1.6}
        windows = np.arange(1, len(one.size) + 1)
        held.plot(windows, 100 * one.coverage, label=one.kind.value, **style)
        size.plot(windows, one.size, label=one.kind.value, **style)
        size.axhline(one.n_classes, color=MUTED, lw=1, ls=":")
        size.set_ylim(0, one.n_classes + 0.6)
    held.axhline(100 * coverage[0].promised, color=MUTED, lw=1, ls=":")
    held.set(ylim=(0, 105), ylabel="sets that hold the texture (%)")
    held.set_title(f"coverage; dotted: promised {coverage[0].promised:.0%}", size=9, loc="left")
    size.set(ylabel="mean number of textures")
    size.set_title("size of the sets; dotted: all, a failure", size=9, loc="left")
    for result in novelty:
        windows = np.arange(1, len(result.detected) + 1)
        colour, name = KIND_COLOURS[result.kind], result.kind.value
        calls.plot(windows, 100 * result.detected, color=colour, lw=1.6, label=f"{name}: untrained")
        style = {"color": colour, "lw": 1.2, "ls": (0, (2, 2))}
        calls.plot(windows, 100 * result.false_alarms, label=f"{name}: trained", **style)
    calls.set(ylim=(0, 105), ylabel="scans called unknown (%)")
    calls.set_title("plates, each texture left out in turn", size=9, loc="left")
    for axes in (held, size, calls):
        axes.set(xlabel="windows of evidence", xlim=(0.5, len(coverage[0].size) + 0.5))
        axes.set_xticks([1, 5, 10, 15, 20])
        axes.grid(axis="y", color=FAINT, lw=0.6)
        if axes.get_legend_handles_labels()[0]:
            place = "upper right" if axes is calls else "lower right"
            axes.legend(frameon=False, fontsize=8, loc=place)
    return save_figure(figure, stem, "How sure an answer is, on held-out trials", origin)


def draw_latencies(latencies: Mapping[str, Floats], origin: str, stem: Path) -> Path:
    """Draw histograms of the latencies, a panel for each kind; return the PNG's path."""
    figure, panels = new_figure((11, 3.8), 1, len(latencies), squeeze=False)
    for axes, (kind, ms) in zip(panels.flat, latencies.items(), strict=True):
        p99, p999 = np.percentile(ms, [99.0, 99.9])
        edges = np.linspace(0.0, LATENCY_ROOM * max(float(ms.max()), 0.1), 51)
        axes.hist(ms, bins=edges.tolist(), color=BLUE)
        axes.set_yscale("log")
        axes.set(xlabel="latency (ms)", ylabel="number", xlim=(0, edges[-1]), ylim=(0.5, None))
        for value, dashes in ((p99, "--"), (p999, ":")):
            axes.axvline(value, color=TEXT, lw=1, ls=dashes)
        title = f"{kind}, n = {len(ms):,}: p99 {p99:.2f} ms (dashed), p99.9 {p999:.2f} ms (dotted)"
        axes.set_title(title, size=9, loc="left", color=TEXT)
    return save_figure(figure, stem, "Latency from the sending of a velocity", origin)


def _plot_curves(axes: Axes, result: FingerResult) -> None:
    k = np.arange(1, result.k_max + 1)
    colour = COLOURS[result.task.key]
    for kind, quoted in zip(KINDS, result.task.quoted, strict=True):
        scaled = kind is ScanKind.SPEED_SCALED
        error = result.standard_error(kind)
        axes.errorbar(
            k,
            100 * result.mean(kind),
            None if error is None else 100 * error,
            color=colour,
            ls="-" if scaled else (0, (4, 2)),
            lw=1.5,
            elinewidth=0.8,
            label=f"{result.task.title}: {kind.value}",
        )
        _plot_quoted(axes, quoted, colour, filled=scaled, k_max=result.k_max)


def _plot_quoted(
    axes: Axes, quoted: QuotedAccuracy, colour: str, *, filled: bool, k_max: int
) -> None:
    """Mark a value of the paper: a diamond at its components, a line for a saturation."""
    face = colour if filled else "white"
    text: dict[str, Any] = {
        "textcoords": "offset points", "size": 8, "color": colour, "zorder": 6,
        "bbox": {"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.85},
    }  # fmt: skip
    if quoted.components is not None:
        place: tuple[float, float] = quoted.components, quoted.percent
        axes.plot(*place, "D", ms=7, color=colour, markerfacecolor=face, zorder=5)
        # Above Original's peak there is often Speed Scaled's curve.
        side = 1 if filled else -1
        text["va"] = "bottom" if filled else "top"
        axes.annotate(f"{quoted.percent:g}", place, xytext=(0, 8 * side), ha="center", **text)
        return
    # Right of the curves, so that they do not cover it.
    ends = k_max * (1.0 + 0.2 * SATURATION_ROOM), k_max * (1.0 + 0.65 * SATURATION_ROOM)
    line = [quoted.percent, quoted.percent]
    axes.plot(ends, line, color=colour, lw=4 if filled else 1.2, alpha=0.6, zorder=5)
    place = ends[1], quoted.percent
    axes.annotate(f"{quoted.percent:g}", place, xytext=(4, 0), ha="left", va="center", **text)


def _mark_legend(axes: Axes, quoted: Sequence[QuotedAccuracy]) -> None:
    """Add what the paper's marks mean, as far as the figure has them."""
    marks: dict[str, Any] = {"color": MUTED, "ls": ""}
    if any(one.components is not None for one in quoted[1::2]):
        axes.plot([], [], marker="D", label="paper: Speed Scaled's peak", **marks)
    axes.plot([], [], marker="D", markerfacecolor="white", label="paper: Original's peak", **marks)
    if any(one.components is None for one in quoted):
        label = "paper: saturation (thick Speed Scaled, thin Original)"
        axes.plot([], [], color=MUTED, lw=3, alpha=0.6, label=label)


def _note(result: FingerResult) -> str:
    """Return what bars and asterisks mean."""
    n = len(result.accuracy[ScanKind.ORIGINAL])
    counted = f"{n * result.n_tested} trials" if result.task is DEPLOYED else f"{n} draws"
    bars = "bars: standard error"
    if result.standard_error(ScanKind.ORIGINAL) is None:
        bars = "one draw, no spread"
    elif result.task is DEPLOYED:
        bars = "bars: standard error of a share"
    first = result.differences()[0]
    rule = describe_rule(first.rule, first.test).replace(";", ",")
    return f"n = {counted}; {bars}; {rule}; grey: Original is better"


def _plot_stars(axes: Axes, result: FingerResult, percent: float) -> None:
    """Mark differences above the curves: one asterisk or two, grey where Original is better."""
    colour = COLOURS[result.task.key]
    for k, difference in enumerate(result.differences(), start=1):
        if difference.stars:
            better = (difference.effect or 0.0) > 0
            axes.text(
                k,
                percent,
                "\n".join(difference.stars),
                ha="center",
                va="bottom",
                linespacing=0.45,
                size=9,
                color=colour if better else MUTED,
            )
