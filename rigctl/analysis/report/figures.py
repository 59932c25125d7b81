"""Figures as SVG and PNG: the raster of a trial, the accuracy of a classification.

Each is drawn on a ``Figure`` of its own without pyplot, so nothing here is global. Whatever comes
from the simulated bench says so in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.held_out import HeldOutPredictions
from rigctl.analysis.paper.statistics import wilson_interval
from rigctl.values import SAMPLE_RATE_HZ, Spikes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
MOST_LETTERS = 40
"""So many letters stand side by side below a confusion matrix; more are turned."""
TEXT, MUTED, FAINT = "#1b1f24", "#59636e", "#e6e9ed"


@dataclass(frozen=True, slots=True)
class TrainGroup:
    """Nine trains that belong together: one channel (SA or RA) of one layer.

    Besides its colour a group has its place and the height of its ticks, for eyes or printers
    that do not tell the colours apart.
    """

    name: str
    meaning: str
    colour: str
    tick: float


GROUPS = (
    TrainGroup("SAI", "slow, top layer", "#00629e", 0.82),
    TrainGroup("RAI", "fast, top layer", "#c24e00", 0.5),
    TrainGroup("SAII", "slow, bottom layer", "#3c9bd1", 0.82),
    TrainGroup("RAII", "fast, bottom layer", "#c08400", 0.5),
)


@dataclass(frozen=True, slots=True)
class TrialPicture:
    """What the raster figure shows of one trial.

    ``samples``: uint16 (n, n_taxels). ``force_s``, ``force_g``: float64 (m,), load cell, seconds
    since the rise of sync. ``origin`` says where it comes from, in a few words.
    """

    title: str
    origin: str
    samples: NDArray[np.uint16]
    spikes: Spikes
    speed_mm_s: float
    force_set_g: float
    force_s: NDArray[np.float64]
    force_g: NDArray[np.float64]


def raster_figure(picture: TrialPicture, stem: Path) -> Path:
    """Force, one taxel and all spikes of a trial; writes ``stem``.svg and .png, returns the PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7.6), layout="constrained")
    rows = figure.subplots(
        3, 1, sharex=True, gridspec_kw={"height_ratios": [1, 1, 4.2], "hspace": 0.04}
    )
    duration_s = len(picture.samples) / SAMPLE_RATE_HZ
    _draw_force(rows[0], picture)
    _draw_taxel(rows[1], picture)
    _draw_spikes(rows[2], picture.spikes)
    rows[2].set_xlim(0, duration_s)
    rows[2].set_xlabel("time since the trial window opened (s)")
    travel = rows[0].secondary_xaxis(
        "top", functions=(lambda t: t * picture.speed_mm_s, lambda x: x / picture.speed_mm_s)
    )
    travel.set_xlabel("texture travelled (mm)", color=MUTED)
    travel.tick_params(colors=MUTED)
    finish(figure, picture.title, picture.origin)
    return save(figure, stem)


def accuracy_figure(held_out: HeldOutPredictions, origin: str, stem: Path) -> Path:
    """Held-out accuracy over components, and who is taken for whom; returns the PNG's path."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.35, 1])
    _draw_accuracy(left, held_out)
    _draw_confusion(right, held_out)
    correct, n = int(held_out.correct_counts()[held_out.shown - 1]), held_out.n
    title = (
        f"Textures told apart on held-out trials: {correct} of {n} "
        f"({correct / n:.0%}) with {held_out.shown} components"
    )
    finish(figure, title, origin)
    return save(figure, stem)


def train_order(n_taxels: int) -> list[tuple[TrainGroup, list[int]]]:
    """Encoder rows (SA 1 … n, RA 1 … n) of each group; the first half of the taxels is on top."""
    half = n_taxels // 2
    top, bottom = list(range(half)), list(range(half, n_taxels))
    rows = (top, [n_taxels + i for i in top], bottom, [n_taxels + i for i in bottom])
    return list(zip(GROUPS, rows, strict=True))


def _draw_force(axes: Axes, picture: TrialPicture) -> None:
    inside = (picture.force_s >= -0.05) & (
        picture.force_s <= len(picture.samples) / SAMPLE_RATE_HZ + 0.05
    )
    axes.axhline(picture.force_set_g, color=MUTED, lw=1, ls=(0, (4, 3)))
    axes.plot(picture.force_s[inside], picture.force_g[inside], color=TEXT, lw=1.1)
    shown = np.append(picture.force_g[inside], picture.force_set_g)
    margin = max(0.02 * picture.force_set_g, 0.15 * float(np.ptp(shown)), 1.0)
    axes.set_ylim(float(shown.min()) - margin, float(shown.max()) + 2 * margin)
    axes.set_ylabel("force (g)")
    _note(axes, f"load cell; dashed: set-point {picture.force_set_g:g} g")
    tidy(axes)


def _draw_taxel(axes: Axes, picture: TrialPicture) -> None:
    """The reading that moves most."""
    taxel = int(picture.samples.std(axis=0).argmax())
    time_s = np.arange(len(picture.samples)) / SAMPLE_RATE_HZ
    axes.plot(time_s, picture.samples[:, taxel], color=TEXT, lw=0.7)
    axes.set_ylabel("reading\n(counts)")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.3 * (high - low))
    _note(axes, f"taxel {taxel + 1}, the liveliest of {picture.samples.shape[1]}")
    tidy(axes)


def _draw_spikes(axes: Axes, spikes: Spikes) -> None:
    y, ticks, names = 0.0, [], []
    groups = train_order(spikes.n_trains // 2)
    for group, rows in groups:
        _draw_group(axes, spikes, group, rows, y)
        ticks += [y, y + len(rows) - 1]
        n_taxels = spikes.n_trains // 2
        names += [str(rows[0] % n_taxels + 1), str(rows[-1] % n_taxels + 1)]
        y += len(rows) + 0.8
    axes.set_yticks(ticks, names)
    axes.set_ylim(y - 0.8, -0.8)
    axes.set_ylabel("taxel", labelpad=2)
    tidy(axes)


def _draw_group(
    axes: Axes, spikes: Spikes, group: TrainGroup, rows: list[int], first_y: float
) -> None:
    """One broken line a group: thousands of single ticks would make a heavy drawing."""
    trains = [spikes.train(row) / SAMPLE_RATE_HZ for row in rows]
    at = np.concatenate(trains)
    y = np.repeat(first_y + np.arange(len(rows)), [len(train) for train in trains])
    half = group.tick / 2
    x3 = np.stack([at, at, np.full_like(at, np.nan)], axis=1).reshape(-1)
    y3 = np.stack([y - half, y + half, np.full_like(at, np.nan)], axis=1).reshape(-1)
    axes.plot(x3, y3, color=group.colour, lw=0.55, solid_capstyle="butt")
    middle = first_y + (len(rows) - 1) / 2
    duration_s = max(spikes.n_samples, 1) / SAMPLE_RATE_HZ
    rate_hz = len(at) / duration_s / len(rows)
    style: dict[str, Any] = {
        "transform": axes.get_yaxis_transform(),
        "color": group.colour,
        "va": "center",
    }
    axes.text(1.012, middle - 0.9, group.name, weight="bold", size=12, **style)
    axes.text(1.012, middle + 1.2, f"{group.meaning}\n{rate_hz:.0f} spikes/s each", size=8, **style)


def _draw_accuracy(axes: Axes, held_out: HeldOutPredictions) -> None:
    from matplotlib.ticker import MaxNLocator

    k = np.arange(1, len(held_out.predictions) + 1)
    correct = held_out.correct_counts()
    low, high = wilson_interval(correct, held_out.n)
    axes.fill_between(k, 100 * low, 100 * high, color=GROUPS[2].colour, alpha=0.22, lw=0)
    axes.plot(k, 100 * correct / held_out.n, color=GROUPS[0].colour, lw=1.8, marker="o", ms=3.5)
    axes.axhline(100 * held_out.chance, color=GROUPS[1].colour, lw=1.3, ls=(0, (5, 3)))
    axes.annotate(
        f"chance {held_out.chance:.0%}",
        (k[-1], 100 * held_out.chance),
        xytext=(0, 4),
        textcoords="offset points",
        ha="right",
        color=GROUPS[1].colour,
    )
    axes.axvline(held_out.shown, color=MUTED, lw=0.8, ls=":")
    axes.set_ylim(0, 103)
    axes.set_xlim(0.5, k[-1] + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("principal components")
    axes.set_ylabel("held-out accuracy (%)")
    axes.set_title(
        f"n = {held_out.n} trials in {held_out.n_folds} folds; band: 95 % interval",
        size=9,
        color=MUTED,
        loc="left",
    )
    tidy(axes)


def _draw_confusion(axes: Axes, held_out: HeldOutPredictions) -> None:
    table = held_out.confusion(held_out.shown)
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for (i, j), count in np.ndenumerate(table):
        if count:
            colour = "white" if share[i, j] > 0.55 else TEXT
            axes.text(j, i, str(count), ha="center", va="center", color=colour)
    places = range(len(held_out.classes))
    longest = max(map(len, held_out.classes))
    turned = 90 if longest * len(held_out.classes) > MOST_LETTERS else 0
    axes.set_xticks(places, held_out.classes, rotation=turned)
    axes.set_yticks(places, held_out.classes)
    axes.set_xlabel("predicted texture")
    axes.set_ylabel("true texture")
    axes.set_title(
        f"trials with {held_out.shown} components (dotted line)", size=9, color=MUTED, loc="left"
    )
    axes.tick_params(length=0)


def _note(axes: Axes, text: str) -> None:
    axes.text(
        0.995, 0.93, text, transform=axes.transAxes, ha="right", va="top", size=8, color=MUTED
    )


def tidy(axes: Axes) -> None:
    """Two spines, a faint grid behind."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", color=FAINT, lw=0.6)
    axes.set_axisbelow(True)


def finish(figure: Figure, title: str, origin: str) -> None:
    """Title above, and below it where the data come from."""
    figure.suptitle(title, size=13, x=0.01, ha="left", color=TEXT)
    figure.supxlabel(origin, size=8.5, x=0.01, ha="left", color=MUTED)


def save(figure: Figure, stem: Path) -> Path:
    """Write both formats; equal data give equal files."""
    import matplotlib as mpl

    stem.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"svg.hashsalt": "rigctl", "svg.fonttype": "none"}):
        figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None})
    png = stem.with_suffix(".png")
    figure.savefig(png, dpi=DPI, metadata={"Software": None})
    return png
