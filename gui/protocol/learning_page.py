"""The tab with the learning curve of the session that the page of a run shows.

A worker process computes the curve while the tab is shown.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, Signal
from PySide6.QtWidgets import QWidget

from gui.analysis.export import TABLE, ExportButton, FileSaver, widget_picture
from gui.analysis.value_file import write_columns, yes_or_no
from gui.analysis.worker import Worker
from gui.widgets.labels import elastic, label, show_text
from gui.widgets.layouts import EventWatch, container, hbox, push_button, vbox
from gui.widgets.plot_axes import (
    LEFT_PX,
    PlotGrid,
    fixed_plot,
    reserve,
    reserve_right,
    title_plot,
    whole_ticks,
)
from gui.widgets.theme import applied_theme, scaled_px
from gui.widgets.typed_paths import typed_path

if TYPE_CHECKING:
    from rigctl.analysis.learning_curve import CurvePoint, SessionCurve

INTERVAL = (
    "Bars: 95 % Wilson interval at a fixed number of trials, of plates as they are mounted now; on "
    "virtual data it held the accuracy in 94 to 98 % of cases"
)
VALUE_NAMES = (
    "trials of each plate and condition",
    "plates",
    "conditions (speed × force)",
    "trials to train on, fewest of a fold",
    "trials tested",
    "trials named right",
    "accuracy (%)",
    "interval low (%)",
    "interval high (%)",
    "chance (%)",
    "simulated",
)
HINT = "Point at the curve to read its values"
LOWEST_PX = 182
GRID_ALPHA = 38
"""Of 255: a faint grid."""
PERCENT_TICKS = range(0, 101, 20)
NO_SESSION = "No session: start a run, or open one."
NO_TRIAL = "Not enough trials yet: no trial counts so far."
COMPUTING = "The first curve of this session is being computed."
NO_CURVE = "No curve yet."
CANCELLED = "Cancelled: press Compute for the curve of the trials so far."
FAILED = "Press Compute to try again."
CANCEL, COMPUTE = "Cancel", "Compute"
CURVE = "learning_curve"
Stage = tuple[str, int, int]
"""A session's folder, its trials that count, and all attempts: what changes the curve."""
STEM = "learning-curve"
"""Name of a saved file."""


def heading(curve: SessionCurve) -> str:
    """Return the newest accuracy with its interval, or why there is none."""
    simulated = "SIMULATED. " if curve.simulated else ""
    if not curve.points:
        return simulated + curve.shortfall
    point = curve.points[-1]
    return (
        f"{simulated}{_percent(point.accuracy)} of {point.tested} held-out trials named right "
        f"({_interval(point)}), chance {_percent(point.chance)}; {len(point.plates)} plates, "
        f"{point.n_trials} of each at {_conditions(point)}; {curve.trials} trials so far."
    )


def point_text(point: CurvePoint) -> str:
    """Return the values of one point, for the pointer."""
    return (
        f"{point.n_trials} of each: {_percent(point.accuracy)} ({_interval(point)}), "
        f"{point.right} of {point.tested} right, {len(point.plates)} plates × "
        f"{_conditions(point)}, chance {_percent(point.chance)}"
    )


def remarks(curve: SessionCurve) -> str:
    """Return what the figure says below the curve."""
    return ". ".join((*curve.remarks, INTERVAL) if curve.points else curve.remarks)


def values(curve: SessionCurve) -> tuple[Any, ...]:
    """Return the columns of ``VALUE_NAMES``."""
    rows = [
        (
            *(point.n_trials, len(point.plates), point.n_conditions, point.trained),
            *(point.tested, point.right, 100 * point.accuracy),
            *(100 * point.low, 100 * point.high, 100 * point.chance),
            yes_or_no(curve.simulated),
        )
        for point in curve.points
    ]
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _interval(point: CurvePoint) -> str:
    return f"95 % interval {100 * point.low:.1f} to {_percent(point.high)}"


def _conditions(point: CurvePoint) -> str:
    return f"{point.n_conditions} condition{'' if point.n_conditions == 1 else 's'}"


class CurveView(PlotGrid):
    """Draws the points; the title says what the pointer is nearest to."""

    def __init__(self) -> None:
        super().__init__()
        self.points: tuple[CurvePoint, ...] = ()
        self.title = HINT
        self.plot = fixed_plot(self.cells, 0, 0)
        self.plot.setLabel("left", "Accuracy (%)")
        self.plot.setLabel("bottom", "Trials of each plate, speed and force")
        reserve(self.plot, "left", LEFT_PX)
        self.plot.getAxis("left").setTicks([[(value, f"{value}") for value in PERCENT_TICKS], []])
        self.plot.setYRange(-4, 106, padding=0)
        self.plot.setXRange(0, 10, padding=0)
        self.plot.getAxis("left").setGrid(GRID_ALPHA)
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.show_points(())
        kinds = QEvent.Type.PaletteChange, QEvent.Type.FontChange
        EventWatch(self, lambda: self.show_points(self.points), *kinds)

    def show_points(self, points: tuple[CurvePoint, ...]) -> None:
        """Draw points, or an empty plot without any."""
        self.points = points
        theme = applied_theme()
        self.colour(theme, self.plot)
        reserve_right(self.cells)
        self.graphics.setMinimumHeight(scaled_px(LOWEST_PX))
        self.plot.clear()
        self._show_title(HINT if points else "")
        if not points:
            return
        x = np.array([point.n_trials for point in points], float)
        y, low, high, chance = (
            100 * np.array([getattr(point, name) for point in points])
            for name in ("accuracy", "low", "high", "chance")
        )
        end = 1.05 * float(x[-1])
        self.plot.setXRange(0, end, padding=0)
        self.plot.getAxis("bottom").setTicks([whole_ticks(end), []])
        width = 0.012 * float(x[-1])
        bars = pg.ErrorBarItem(
            x=x, y=y, top=high - y, bottom=y - low, beam=width, pen=pg.mkPen(theme.accent, width=1)
        )
        dashes = pg.mkPen(theme.muted, width=1, dash=[4, 3])
        line = pg.mkPen(theme.accent, width=2)
        self.plot.addItem(bars)
        self.plot.addItem(pg.PlotDataItem(x, chance, pen=dashes))
        symbols = {"symbol": "o", "symbolSize": 7, "symbolBrush": theme.accent, "symbolPen": None}
        self.plot.addItem(pg.PlotDataItem(x, y, pen=line, **symbols))
        self._name_chance(float(x[-1]), float(chance[-1]))

    def _name_chance(self, x: float, chance: float) -> None:
        name = pg.TextItem("chance", color=applied_theme().muted, anchor=(1, 1))
        self.plot.addItem(name)
        name.setPos(x, chance)

    def _point_at(self, place: QPointF) -> None:
        if not self.points or not self.plot.sceneBoundingRect().contains(place):
            return
        at = self.plot.getViewBox().mapSceneToView(place).x()
        self._show_title(point_text(min(self.points, key=lambda point: abs(point.n_trials - at))))

    def _show_title(self, text: str) -> None:
        self.title = text
        title_plot(self.plot, text, applied_theme().muted)


class LearningPage(QWidget):
    """Shows a curve, how far its computation is, and saves it.

    It asks for another one whenever the session has got further, of a process of its own, so that
    neither the trial table nor an analysis waits for it.
    """

    reported = Signal(str, str)

    def __init__(self) -> None:
        super().__init__()
        self.curve: SessionCurve | None = None
        self.heading = label(NO_SESSION, "heading", wraps=True)
        self.view = CurveView()
        self.remarks = label("", "muted", wraps=True)
        self.progress = elastic(label("", "muted"))
        self.button = push_button(CANCEL, self._press, "End the computation, or begin it again")
        self.save_button = ExportButton("png", "svg", "pdf", TABLE)
        self.save_button.export_requested.connect(self._export)
        figure = vbox(self.heading, self.view, self.remarks, spacing=4, tall=1)
        self.figure = container(figure)
        """What is saved as a picture."""
        foot = hbox(self.progress, self.button, self.save_button, spacing=6)
        self.setLayout(vbox(self.figure, container(foot), spacing=4, margins=(6, 6, 6, 4), tall=0))
        self.worker, self.files = Worker(), FileSaver()
        self._stage: Stage = ("", 0, 0)
        self._computed: Stage | None = None
        self._is_cancelled = False
        self.files.saved.connect(lambda path: self.reported.emit("analysis", f"saved {path}"))
        self.files.failed.connect(lambda text: self.reported.emit("refused", text))
        EventWatch(self, self.submit, QEvent.Type.Show)
        self.worker.progressed.connect(self.show_progress)
        self.worker.finished.connect(self._finish)
        self.worker.failed.connect(self._fail)
        self.show_text(NO_SESSION)
        self.show_idle()

    def show_curve(self, curve: SessionCurve) -> None:
        """Show the curve of the trials so far, or what it still needs."""
        self.curve = curve
        self.view.show_points(curve.points)
        show_text(self.heading, heading(curve))
        show_text(self.remarks, remarks(curve))
        self.save_button.setEnabled(bool(curve.points))

    def show_text(self, sentence: str) -> None:
        """Show a sentence in place of a curve."""
        self.curve = None
        self.view.show_points(())
        show_text(self.heading, sentence)
        show_text(self.remarks, "")
        self.save_button.setEnabled(False)

    def show_progress(self, stage: str, share: float) -> None:
        """Show how far the computation is."""
        show_text(self.progress, f"{stage}, {100 * share:.0f} %")

    def show_computing(self) -> None:
        """Offer Cancel while the curve is computed."""
        if self.curve is None:
            self.show_text(COMPUTING)
        self.button.setText(CANCEL)
        self.button.setEnabled(True)

    def show_cancelled(self) -> None:
        """Offer Compute after Cancel."""
        self.show_idle(CANCELLED)
        if self.curve is None:
            self.show_text(NO_CURVE)

    def show_idle(self, text: str = "") -> None:
        """Show that nothing is computed; with a ``text`` that says why, offer Compute."""
        self.button.setText(COMPUTE)
        self.button.setEnabled(bool(text))
        show_text(self.progress, text)

    def show_session(self, folder: str, committed: int, attempts: int) -> None:
        """Take note of how far the session of the page is."""
        stage = folder, committed, attempts
        if stage == self._stage:
            return
        if folder != self._stage[0]:
            self._leave(folder)
        self._stage = stage
        self.submit()

    def submit(self) -> None:
        """Ask for the curve, if it is looked at and the process is free."""
        folder, committed, _ = self._stage
        is_due = self._computed != self._stage and committed > 0 and not self._is_cancelled
        if not is_due or self.worker.is_busy or not self.isVisible():
            return
        self._computed = self._stage
        self.show_computing()
        self.worker.submit(CURVE, folder=folder)

    def close_worker(self) -> None:
        """End the worker process and what is being saved, as before the window closes."""
        self.files.close()
        self.worker.close()

    def _leave(self, folder: str) -> None:
        """Show another session, and end what is computed for the one before."""
        if self.worker.is_busy:
            self.worker.cancel()
        self._computed, self._is_cancelled = None, False
        self.show_idle()
        self.show_text(NO_TRIAL if folder else NO_SESSION)

    def _press(self) -> None:
        if self.worker.is_busy:
            self.worker.cancel()
            self._is_cancelled = True
            self.show_cancelled()
            return
        self._is_cancelled, self._computed = False, None
        self.submit()

    def _finish(self, task: str, result: Any) -> None:
        if result.folder == self._stage[0]:
            self.show_curve(result)
            self.show_idle()
        self.submit()

    def _fail(self, task: str, sentence: str) -> None:
        self.show_idle(FAILED)
        self.show_text(sentence)

    def _export(self, suffix: str) -> None:
        """Save the curve beside its session."""
        curve = self.curve
        if curve is None:
            return
        session = typed_path(curve.folder).absolute()
        stem = f"{STEM}-simulated" if curve.simulated else STEM
        folder = f"{session}-figures"
        if suffix == TABLE:
            write = partial(write_columns, VALUE_NAMES, values(curve))
            self.files.save(folder, stem, suffix, write)
        else:
            self.files.save(folder, stem, suffix, widget_picture(self.figure))
