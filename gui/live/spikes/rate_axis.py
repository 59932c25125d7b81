"""The axis of the spike rates: per second, or per mm of texture."""

from __future__ import annotations

import pyqtgraph as pg

from gui.live.spikes.spike_rates import (
    FULL_SCALE_A_MM,
    FULL_SCALE_HZ,
    RATE_TICKS_A_MM,
    RATE_TICKS_HZ,
)
from gui.widgets.plots.plot_axes import label_axis
from gui.widgets.theme import Theme

A_SECOND = "Rate in the last second (Hz)"
A_MM = "Rate in the last second (1/mm)"


def label_rates(plot: pg.PlotItem, theme: Theme, is_per_mm: bool) -> None:
    """Write the numbers and the unit of the rates below a plot whose width is the full scale."""
    ticks = [(float(hz), f"{hz}") for hz in RATE_TICKS_HZ]
    if is_per_mm:
        ticks = [(n * FULL_SCALE_HZ / FULL_SCALE_A_MM, f"{n}") for n in RATE_TICKS_A_MM]
    plot.getAxis("bottom").setTicks([ticks, []])
    label_axis(plot, "bottom", A_MM if is_per_mm else A_SECOND, theme)
