"""The quality of a session's trials: every taxel over all attempts, drift, and verdicts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtGui import QShowEvent

from gui.analysis.task_values import JudgedTrials
from gui.analysis.value_file import data_words
from gui.widgets.labels import label
from gui.widgets.plot_axes import (
    ColourScale,
    PlotGrid,
    label_axis,
    reserve,
    time_plot,
    title_plot,
)
from gui.widgets.theme import Theme
from rigctl.session.data_quality import (
    GIVEN_UP,
    MARKED,
    QUARANTINE,
    REPEAT,
    SHOWN_PERCENT,
    TITLES,
    VERDICTS,
)

HINT = "Choose a trial of a session: all its trials are judged beside equal ones."
SYMBOLS = {GIVEN_UP: "x", REPEAT: "t1", QUARANTINE: "d"}
LEAST_PX = 150, 80, 70
_SCALE_PX, _SCALE_AXIS_PX = 12, 52


class QualityView(PlotGrid):
    """Three plots over the attempts of a session, which may grow; a line says what was found."""

    shown = Signal()
    """The page has come to the front."""

    def __init__(self, theme: Theme) -> None:
        self.summary = label(HINT, "muted", wraps=True)
        self.summary.setContentsMargins(8, 6, 8, 2)
        super().__init__(self.summary)
        self._theme = theme
        self.judged: JudgedTrials | None = None
        names = "Taxel", "Lifted (counts)", ""
        self.taxels, self.drift, self.verdicts = self.plots = [
            time_plot(self.cells, row, name, last=row == len(names) - 1)
            for row, name in enumerate(names)
        ]
        for plot in self.plots[1:]:
            plot.setXLink(self.taxels)
        self.image = pg.ImageItem(axisOrder="row-major")
        self.taxels.addItem(self.image)
        self.taxels.invertY(True)
        self.scale = ColourScale(self.image, pg.colormap.get("CET-D1A"), _SCALE_PX)
        self.scale.show_levels(-SHOWN_PERCENT, SHOWN_PERCENT)
        self.cells.addItem(self.scale, 0, 1)
        reserve(self.scale, "right", _SCALE_AXIS_PX)
        self.set_theme(theme)

    @property
    def is_behind(self) -> bool:
        """Whether attempts of the session that is shown are to be judged yet."""
        return self.judged is not None and self.judged.left > 0

    def showEvent(self, event: QShowEvent) -> None:
        """Ask for the session's trials to be judged."""
        super().showEvent(event)
        self.shown.emit()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour(theme, *self.plots)
        self.scale.colour(theme, "% off")
        self.reserve_plots(74, *LEAST_PX)
        for plot, title in zip(self.plots, TITLES, strict=False):
            title_plot(plot, title, theme.muted)
        self.show_judged(self.judged)

    def show_judged(self, judged: JudgedTrials | None) -> None:
        """Show what was found of a session, or a hint."""
        self.judged = judged
        for plot in self.plots[1:]:
            plot.clear()
        self.image.clear()
        self.summary.setText(HINT if judged is None else summary_of(judged))
        if judged is None:
            return
        picture = judged.picture
        n_taxels = max(1, len(picture.off_percent))
        self.taxels.setXRange(0, max(1, picture.n_attempts), padding=0)
        self.taxels.setYRange(0, n_taxels, padding=0)
        step = max(1, n_taxels // 6)
        ticks = [(i + 0.5, f"T{i + 1}") for i in range(0, n_taxels, step)]
        self.taxels.getAxis("left").setTicks([ticks, []])
        if picture.off_percent.size:
            self.image.setImage(picture.off_percent, autoLevels=False)
            self.image.setRect(0, 0, picture.n_attempts, n_taxels)
        label_axis(self.verdicts, "bottom", "Attempt", self._theme)
        self._draw_drift()
        self._draw_verdicts()

    def values(self) -> tuple[tuple[str, ...], tuple[Any, ...]]:
        """Return names and columns of the picture: each taxel beside equal trials, by attempt."""
        if self.judged is None:
            return ("first attempt",), (np.zeros(0, np.int64),)
        picture = self.judged.picture
        names = [f"taxel {i + 1} off equal trials (%)" for i in range(len(picture.off_percent))]
        return ("first attempt", *names), (picture.edges[:-1] + 1, *picture.off_percent)

    def _draw_drift(self) -> None:
        assert self.judged is not None
        picture, colour = self.judged.picture, self._theme.layers[0]
        if not len(picture.drift_at):
            return
        counts = picture.drift_counts
        ends = [pg.PlotCurveItem(picture.drift_at, f(counts, axis=1)) for f in (np.min, np.max)]
        middle = np.median(counts, axis=1)
        band = pg.FillBetweenItem(*ends, brush=pg.mkBrush(self._theme.line))
        for item in (band, pg.PlotCurveItem(picture.drift_at, middle, pen=pg.mkPen(colour))):
            self.drift.addItem(item)
        reach = max(1.0, float(np.abs(counts).max()))
        self.drift.setYRange(-reach, reach, padding=0.05)

    def _draw_verdicts(self) -> None:
        assert self.judged is not None
        theme, marks = self._theme, self.judged.picture.marks
        colours = {GIVEN_UP: theme.bad, REPEAT: theme.warn, QUARANTINE: theme.accent}
        for row, verdict in enumerate(MARKED):
            points = pg.ScatterPlotItem(
                marks[verdict] + 0.5, np.full(len(marks[verdict]), row), symbol=SYMBOLS[verdict],
                size=9, pen=None, brush=pg.mkBrush(colours[verdict]),
            )  # fmt: skip
            self.verdicts.addItem(points)
        self.verdicts.getAxis("left").setTicks([list(enumerate(MARKED)), []])
        self.verdicts.setYRange(-0.6, len(MARKED) - 0.4, padding=0)


def summary_of(judged: JudgedTrials) -> str:
    """Return the verdicts in a sentence, and how many attempts are to be judged yet."""
    counts = ", ".join(f"{judged.counts[verdict]:,} {verdict}" for verdict in VERDICTS)
    left = f"; {judged.left:,} attempts are to be judged yet" if judged.left else ""
    why = f" Most often: {judged.commonest}." if judged.commonest else ""
    origin = f"{data_words(simulated=True)}. " if judged.simulated else ""
    return f"{origin}{judged.picture.n_attempts:,} attempts: {counts}{left}.{why}"
