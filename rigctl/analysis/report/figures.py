"""Figures of signals by matplotlib, as SVG and PNG: the raster of a trial, and what all share.

Figures are made without pyplot, so there is no global state. A figure of simulated data says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import SAMPLE_RATE_HZ, Spikes

_CHANNELS = (("slow", ("#00629e", "#3c9bd1"), 0.82), ("fast", ("#c24e00", "#c08400"), 0.5))
"""Of SA and RA: words, colours of the top and of the bottom layer, height of a tick."""


@dataclass(frozen=True, slots=True)
class TrainGroup:
    """The spike trains of one channel (SA or RA) of one layer.

    ``rows``: theirs in :class:`rigctl.values.Spikes`. Position and tick height mark a group too,
    for readers and printers without colours.
    """

    name: str
    description: str
    colour: str
    tick_height: float
    rows: range


def train_groups(layout: SensorLayout) -> tuple[TrainGroup, ...]:
    """Return the groups of a sensor from the top, SA before RA in each layer."""
    groups = []
    for number, (name, rows) in enumerate(layout.train_groups()):
        layer, channel = divmod(number, len(_CHANNELS))
        words, colours, tick_height = _CHANNELS[channel]
        description = ", ".join(filter(None, (words, _layer_words(layout, layer))))
        colour = _shade(colours, layer, len(layout.layers))
        groups.append(TrainGroup(name, description, colour, tick_height, rows))
    return tuple(groups)


def _layer_words(layout: SensorLayout, layer: int) -> str:
    if len(layout.layers) == 1:
        return ""
    if len(layout.layers) == 2:
        return ("top layer", "bottom layer")[layer]
    return f"layer {layer + 1} from the top"


def _shade(colours: tuple[str, str], layer: int, n_layers: int) -> str:
    """Return the colour of a layer, evenly between those of the top and of the bottom layer."""
    share = layer / max(n_layers - 1, 1)
    top, bottom = (np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for c in colours)
    mixed = np.rint(top + share * (bottom - top)).astype(int)
    return "#" + "".join(f"{value:02x}" for value in mixed)


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
TEXT, MUTED, FAINT = "#1b1f24", "#59636e", "#e6e9ed"
STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "x",
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
}


SA_COLOUR, RA_COLOUR = "#00629e", "#c24e00"


@dataclass(frozen=True, slots=True)
class RasterData:
    """The contents of the raster figure of one trial.

    ``samples``: uint16 (n, n_taxels). ``force_s``, ``force_g``: float64 (m,), load cell, seconds
    since the rising edge of sync. ``origin``: the source of the data, in a few words. ``layout``:
    that of the sensor.
    """

    title: str
    origin: str
    samples: NDArray[np.uint16]
    spikes: Spikes
    speed_mm_s: float
    force_set_g: float
    force_s: NDArray[np.float64]
    force_g: NDArray[np.float64]
    layout: SensorLayout


def draw_raster(data: RasterData, stem: Path) -> Path:
    """Draw force, one taxel and all spikes of a trial to ``stem``.svg and .png; return the PNG."""
    grid = {"height_ratios": [1, 1, 4.2], "hspace": 0.04}
    figure, rows = new_figure((10, 7.6), 3, 1, sharex=True, gridspec_kw=grid)
    _plot_force(rows[0], data)
    _plot_taxel(rows[1], data)
    _plot_spikes(rows[2], data.spikes, data.layout)
    rows[2].set_xlim(0, len(data.samples) / SAMPLE_RATE_HZ)
    rows[2].set_xlabel("time since the trial window opened (s)")
    travel = rows[0].secondary_xaxis(
        "top", functions=(lambda t: t * data.speed_mm_s, lambda x: x / data.speed_mm_s)
    )
    travel.set_xlabel("texture travelled (mm)", color=MUTED)
    travel.tick_params(colors=MUTED)
    return save_figure(figure, stem, data.title, data.origin)


def _plot_force(axes: Axes, data: RasterData) -> None:
    inside = (data.force_s >= -0.05) & (data.force_s <= len(data.samples) / SAMPLE_RATE_HZ + 0.05)
    axes.axhline(data.force_set_g, color=MUTED, lw=1, ls=(0, (4, 3)))
    axes.plot(data.force_s[inside], data.force_g[inside], color=TEXT, lw=1.1)
    shown = np.append(data.force_g[inside], data.force_set_g)
    margin = max(0.02 * data.force_set_g, 0.15 * float(np.ptp(shown)), 1.0)
    axes.set_ylim(float(shown.min()) - margin, float(shown.max()) + 2 * margin)
    axes.set_ylabel("force (g)")
    _annotate(axes, f"load cell; dashed: set-point {data.force_set_g:g} g")


def _plot_taxel(axes: Axes, data: RasterData) -> None:
    """Plot the reading with the largest standard deviation."""
    taxel = int(data.samples.std(axis=0).argmax())
    time_s = np.arange(len(data.samples)) / SAMPLE_RATE_HZ
    axes.plot(time_s, data.samples[:, taxel], color=TEXT, lw=0.7)
    axes.set_ylabel("reading\n(counts)")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.3 * (high - low))
    _annotate(axes, f"taxel {taxel + 1}, the most active of {data.samples.shape[1]}")


def _plot_spikes(axes: Axes, spikes: Spikes, layout: SensorLayout) -> None:
    y, ticks, names = 0.0, [], []
    for group in train_groups(layout):
        _plot_group(axes, spikes, group, y)
        ends = sorted({0, len(group.rows) - 1})
        ticks += [y + end for end in ends]
        names += [str(group.rows[end] % layout.n_taxels + 1) for end in ends]
        y += len(group.rows) + 0.8
    axes.set_yticks(ticks, names)
    axes.set_ylim(y - 0.8, -0.8)
    axes.set_ylabel("taxel", labelpad=2)


def _plot_group(axes: Axes, spikes: Spikes, group: TrainGroup, first_y: float) -> None:
    """Plot a group as one broken line: thousands of single ticks would make a large file."""
    rows = group.rows
    trains = [spikes.train(row) / SAMPLE_RATE_HZ for row in rows]
    at = np.concatenate(trains)
    y = np.repeat(first_y + np.arange(len(rows)), [len(train) for train in trains])
    half = group.tick_height / 2
    line_x = np.stack([at, at, np.full_like(at, np.nan)], axis=1).reshape(-1)
    line_y = np.stack([y - half, y + half, np.full_like(at, np.nan)], axis=1).reshape(-1)
    axes.plot(line_x, line_y, color=group.colour, lw=0.55, solid_capstyle="butt")
    middle = first_y + (len(rows) - 1) / 2
    duration_s = max(spikes.n_samples, 1) / SAMPLE_RATE_HZ
    rates = f"{group.description}\n{len(at) / duration_s / len(rows):.0f} spikes/s each"
    label = partial(
        axes.text, 1.012, transform=axes.get_yaxis_transform(), color=group.colour, va="center"
    )
    label(middle - 0.9, group.name, weight="bold", size=12)
    label(middle + 1.2, rates, size=8)


def _annotate(axes: Axes, text: str) -> None:
    axes.text(
        0.995, 0.93, text, transform=axes.transAxes, ha="right", va="top", size=8, color=MUTED
    )


def new_figure(
    size: tuple[float, float], rows: int, columns: int, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure and its axes in our style; size in inches, options of ``subplots``."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    with mpl.rc_context(STYLE):
        return figure, figure.subplots(rows, columns, **options)


def show_dollars(figure: Figure) -> None:
    """Show texts as they are: names of textures are no formulas, and half of one is an error."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            text.set_parse_math(False)


def caption(figure: Figure, title: str, origin: str) -> None:
    """Add the title, and the origin of the data at the foot."""
    figure.suptitle(title, size=13, x=0.01, ha="left", color=TEXT)
    figure.supxlabel(origin, size=8.5, x=0.01, ha="left", color=MUTED)
    show_dollars(figure)


def save_figure(figure: Figure, stem: Path, title: str, origin: str) -> Path:
    """Add the title, and the origin of the data at the foot; save as SVG and PNG; return the PNG.

    Equal data give equal files.
    """
    import matplotlib as mpl

    caption(figure, title, origin)
    stem.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"svg.hashsalt": "rigctl", "svg.fonttype": "none"}):
        figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None})
    png = stem.with_suffix(".png")
    figure.savefig(png, dpi=DPI, metadata={"Software": None})
    return png
