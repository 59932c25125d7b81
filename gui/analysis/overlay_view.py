"""Force, readings and spikes of several trials over one time axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QCheckBox, QWidget

from gui.analysis.accuracy import COLOURS, SAMPLE, CurveLook
from gui.analysis.trial_overlay import MOST_TRIALS, OverlaidTrial, TrialOverlay
from gui.analysis.trial_view import LEAST_PX
from gui.analysis.value_file import data_words
from gui.live.drum_course import thin_out
from gui.widgets.layouts import FlowLayout, container, vbox
from gui.widgets.plot_axes import Plot, PlotGrid, label_axis, reserve_right, time_plot
from gui.widgets.theme import Theme

_DASHES: tuple[tuple[float, ...], ...] = (
    (), (6, 3), (1.5, 2), (8, 2, 1.5, 2), (12, 4), (4, 2, 1.5, 2, 1.5, 2),
)  # fmt: skip
LOOKS = tuple(
    CurveLook(*colours, dashes, "")
    for colours, dashes in zip(COLOURS.values(), _DASHES, strict=False)
)
"""Each trial has a colour and dashes of its own."""
assert len(LOOKS) == MOST_TRIALS
_NAMES = (
    "force time (s)", "force (g)", "time (s)", "reading (counts)", "spike time (s)",
    "spike time with C (s)", "scaled spike time with C (s)",
)  # fmt: skip
RASTERS = {
    "Spikes": "spikes_s",
    "Force<br>scaled": "forced_s",
    "Speed and<br>force scaled": "scaled_s",
}
"""Label of each row of spikes, before and behind the modules, and the times that it shows."""
HEIGHTS_PX = (80, 80, 60, 100, 105)
Numbered = list[tuple[int, OverlaidTrial]]
"""Trials, each with the number of its look."""
EACH_ITS_OWN = "Each trial has its colour, its dashes and its row of spikes."


class OverlayPlots(PlotGrid):
    """Force, a taxel's reading and its spikes; drag moves and the wheel zooms all in time.

    The last row has scaled time, and moves alone: a moment of each trial is at another place there.
    Only what is in view is drawn, of many points the lowest and highest.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.plots = [
            time_plot(self.cells, row, name, last=row >= 3)
            for row, name in enumerate(("Force<br>(g)", "Reading", *RASTERS))
        ]
        for plot in self.plots:
            plot.setMouseEnabled(x=True, y=False)
        for plot in self.plots[1:-1]:
            plot.setXLink(self.plots[0])
        self._curves: list[tuple[pg.PlotCurveItem, NDArray[np.float64], NDArray[np.float64]]] = []
        self.plots[0].getViewBox().sigXRangeChanged.connect(lambda *_: self._draw())
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme; the trials are drawn by the next :meth:`show_trials`."""
        self._theme = theme
        self.colour(theme, *self.plots)
        label_axis(self.plots[3], "bottom", "Time since the first sample (s)", theme)
        label_axis(self.plots[4], "bottom", "Scaled time, that at 120 mm/s (s)", theme)
        self.reserve_plots(LEAST_PX[0], *HEIGHTS_PX)
        reserve_right(self.cells)

    def show_trials(self, heading: str, taxel: int, trials: Numbered) -> None:
        """Show trials."""
        self._curves = []
        for plot in self.plots:
            plot.clear()
        self.show_heading(self.plots[0], heading, self._theme)
        label_axis(self.plots[1], "left", f"T{taxel + 1}<br>(counts)", self._theme)
        for row, (number, trial) in enumerate(trials):
            pen = LOOKS[number].pen(self._theme)
            self._add(self.plots[0], pen, trial.force_s, trial.force_g)
            self._add(self.plots[1], pen, trial.reading_s, trial.reading)
            height = -row - np.array([0.15, 0.85])
            solid = pg.mkPen(LOOKS[number].colour(self._theme), width=1)
            for plot, name in zip(self.plots[2:], RASTERS.values(), strict=True):
                times_s = getattr(trial, name)
                x, y = np.repeat(times_s, 2), np.tile(height, len(times_s))
                plot.addItem(pg.PlotCurveItem(x, y, connect="pairs", pen=solid))
        self._fit(trials)
        self._draw()

    def _add(self, plot: Plot, pen: Any, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        curve = pg.PlotCurveItem(pen=pen, connect="finite")
        plot.addItem(curve)
        self._curves.append((curve, x, y))

    def _fit(self, trials: Numbered) -> None:
        """Show all of the trials: from the first sample to the end of the longest."""
        ends = [trial.reading_s[-1] for _, trial in trials]
        for plot, name in ((self.plots[0], "force_g"), (self.plots[1], "reading")):
            values = np.concatenate([np.zeros(0), *(getattr(trial, name) for _, trial in trials)])
            known = values[np.isfinite(values)]
            low, high = (known.min(), known.max()) if len(known) else (0.0, 1.0)
            plot.setYRange(low, max(high, low + 1.0), padding=0.05)
        ticks = [(-row - 0.5, f"{number + 1}") for row, (number, _) in enumerate(trials)]
        for plot in self.plots[2:]:
            plot.setYRange(-max(len(trials), 1), 0, padding=0)
            plot.getAxis("left").setTicks([ticks, []])
        self.plots[0].setXRange(0, max(ends, default=1.0), padding=0)
        last_s = [trial.scaled_s.max(initial=0.0) for _, trial in trials]
        self.plots[4].setXRange(0, max(last_s, default=0.0) or 1.0, padding=0.01)

    def _draw(self) -> None:
        left_s, right_s = self.plots[0].getViewBox().viewRange()[0]
        for curve, x, y in self._curves:
            first, end = np.searchsorted(x, [left_s, right_s])
            part = slice(max(0, first - 1), end + 1)
            curve.setData(*thin_out(x[part], y[part]))


class OverlayView(QWidget):
    """The plots below a legend that switches trials off and on."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.overlay: TrialOverlay | None = None
        self.plots = OverlayPlots(theme)
        self.legend = [QCheckBox() for _ in LOOKS]
        for box in self.legend:
            box.setIconSize(SAMPLE)
            box.toggled.connect(lambda _: self._show())
        legend = container(FlowLayout(*self.legend, margins=(8, 0, 8, 0)))
        self.setLayout(vbox(legend, self.plots, tall=1))
        self.show_overlay(None)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)
        for box, look in zip(self.legend, LOOKS, strict=True):
            box.setIcon(look.sample(theme))
        self._show()

    def show_overlay(self, overlay: TrialOverlay | None) -> None:
        """Show other trials, or none."""
        self.overlay = overlay
        trials = overlay.trials if overlay is not None else ()
        for number, box in enumerate(self.legend):
            box.setVisible(number < len(trials))
            box.setChecked(True)
            box.setText(f"{number + 1} {trials[number].name}" if number < len(trials) else "")
        self._show()

    @property
    def note(self) -> str:
        """What is shown, in words."""
        assert self.overlay is not None
        origin = f"{data_words(simulated=True)}. " if self.overlay.simulated else ""
        words = (
            origin + f"{self.overlay.neuron}.",
            EACH_ITS_OWN,
            self._scaling(),
            self.overlay.left_out,
        )
        return " ".join(filter(None, words))

    def _scaling(self) -> str:
        """Return the C of each trial, or why the force is not scaled."""
        assert self.overlay is not None
        if self.overlay.is_ra:
            return "C is of SA alone."
        known = [
            f"{number} no C" if trial.c is None else f"{number} {trial.c:.3g}"
            for number, trial in enumerate(self.overlay.trials, 1)
        ]
        return f"C: {', '.join(known)}." if known else ""

    def values(self) -> tuple[tuple[str, ...], tuple[NDArray[np.float64], ...]]:
        """Return names and columns of the trials; shorter columns end in empty cells."""
        assert self.overlay is not None
        names, columns = [], []
        for trial in self.overlay.trials:
            names += [f"{trial.name}: {name}" for name in _NAMES]
            columns += [np.asarray(column) for column in trial[1 : 1 + len(_NAMES)]]
        n = max(map(len, columns), default=0)
        padded = tuple(np.pad(c, (0, n - len(c)), constant_values=np.nan) for c in columns)
        return tuple(names), padded

    def _show(self) -> None:
        if self.overlay is None:
            return
        numbered = enumerate(zip(self.legend, self.overlay.trials, strict=False))
        shown = [(number, trial) for number, (box, trial) in numbered if box.isChecked()]
        heading = f"{self.overlay.neuron}, {self.overlay.condition}"
        self.plots.show_trials(heading, self.overlay.taxel, shown)
