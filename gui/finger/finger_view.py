"""The finger's part of the middle of the window: task, plate, plots, answer, confusion."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QSize
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QWidget

from gui.finger.answer_view import AnswerView
from gui.finger.confusion_view import ConfusionView
from gui.finger.plate_view import PlateView
from gui.finger.probability_bars import ProbabilityBars
from gui.finger.scan_plots import ScanPlots, velocity_title
from gui.finger.scan_record import ScanRecord
from gui.widgets.formatting import capitalised
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import container, hbox, scroll_area, vbox
from gui.widgets.theme import Theme, scaled_px
from rigctl.acquisition.protocol.pause_reasons import reason_words
from rigctl.realtime.live_file import FingerLiveReader
from rigctl.realtime.messages import FingerEngineStatus, FingerRunStatus

_RIGHT_PX, _LEFT_PX, _GAP_PX = 262, 296, 8
"""Narrower columns cut their texts; the right one then stands above the left one."""
_TRACK_ROWS = 4096
_PATH_S = 10.0


class FingerView(QWidget):
    """Shows status, record and live data; asks for nothing."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.record = ScanRecord()
        self.task, self.progress = label("", "task", wraps=True), label("", "heading")
        self.notice = label("", "warn", wraps=True)
        self.plate, self.plots = PlateView(), ScanPlots(theme)
        self.answer, self.bars = AnswerView(), ProbabilityBars()
        self.confusion, self.velocity_title = ConfusionView(), label("", "muted", wraps=True)
        self._path_since_s = 0.0
        self._lay_out()
        self.clear()

    def clear(self) -> None:
        """Forget everything, as when another engine is connected."""
        self.record.clear()
        self._path_since_s = 0.0
        self.plots.clear_history()
        self.plate.show_path(np.zeros(0), np.zeros(0))
        self.show_status(FingerEngineStatus())
        self.show_record()

    def refresh(self, live: FingerLiveReader) -> None:
        """Pull the live data and draw what is new."""
        self.plots.refresh(live, self.record)
        track = live.track(_TRACK_ROWS)
        if len(track):
            since_s = max(self._path_since_s, float(track.time_s[-1]) - _PATH_S)
            shown = (track.time_s >= since_s) & track.valid
            self.plate.show_path(track.along_mm[shown], track.across_mm[shown])

    def begin_slide(self, at_s: float) -> None:
        """Begin a new path at this loop time."""
        self._path_since_s = at_s

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show position, task, progress and the answers so far."""
        run = status.run
        self.plate.show_status(status)
        show_text(self.task, task_words(status))
        set_property(self.task, "level", "bad" if run.state == "failed" else "ok")
        show_text(self.progress, _progress_words(status))
        self.bars.show_textures(run.textures)
        self.answer.coverage = run.coverage
        if run.quality != self.plots.quality:
            self.plots.set_quality(run.quality)
        self.confusion.show_run(run)

    def show_record(self, sent_s: float | None = None) -> None:
        """Show the newest answer; ``sent_s``: when the velocity that led to it was sent."""
        self.answer.show_record(self.record, sent_s)
        self.bars.show_record(self.record)
        show_text(self.velocity_title, velocity_title(self.record, self.plots.quality))
        reasons = "; ".join(self.record.reasons)
        show_text(self.notice, f"⚠ The last attempt does not count: {reasons}" if reasons else "")
        self.notice.setVisible(bool(reasons))

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to the plots; the rest follows the application's."""
        self.plots.set_theme(theme)

    def _lay_out(self) -> None:
        banner = QFrame()
        banner.setProperty("role", "card")
        head = hbox(self.task, self.progress, spacing=10)
        banner.setLayout(vbox(head, self.notice, spacing=0, margins=(10, 4, 10, 4)))
        left = vbox(self.plate, self.velocity_title, self.plots, spacing=3)
        left.setStretch(2, 1)
        right = vbox(self.answer, self.bars, self.confusion, spacing=6)
        for place, stretch in enumerate((4, 3, 4)):
            right.setStretch(place, stretch)
        self._right = container(right)
        self._side = scroll_area(self._right)
        self._body = hbox(container(left), self._side, spacing=_GAP_PX)
        self._body.setStretch(0, 3)
        self._body.setStretch(1, 1)
        column = vbox(banner, spacing=5)
        column.addLayout(self._body, 1)
        self.setLayout(column)

    def minimumSizeHint(self) -> QSize:
        """Return the width of one column: the other one then stands above it."""
        width_px = scaled_px(max(_LEFT_PX, _RIGHT_PX))
        return QSize(width_px, super().minimumSizeHint().height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the columns beside each other where there is room."""
        super().resizeEvent(event)
        self._arrange()

    def _arrange(self) -> None:
        is_wide = self.width() >= scaled_px(_LEFT_PX + _GAP_PX + _RIGHT_PX)
        direction = QBoxLayout.Direction
        self._body.setDirection(direction.LeftToRight if is_wide else direction.BottomToTop)
        least_px = 0 if is_wide else self._right.minimumSizeHint().height()
        self._side.setMinimumSize(scaled_px(_RIGHT_PX), least_px)


def task_words(status: FingerEngineStatus) -> str:
    """Return what the operator is to do now."""
    run = status.run
    if not run.is_active:
        return _idle_words(run)
    if run.state == "paused":
        return f"Paused: {reason_words(run.reasons) or 'press Resume'}"
    if run.state == "prompt" and run.prompt is not None:
        return run.prompt.text
    if run.scan is None:
        return "Getting ready"
    what = f"Plate {run.scan.texture}, {run.scan.profile}"
    return f"{what}: scanning" if run.scan.scanning else f"{what}: slide over the plate"


def _idle_words(run: FingerRunStatus) -> str:
    if not run.has_ended:
        return "Choose a stage and press Start"
    return capitalised(run.text)


def _progress_words(status: FingerEngineStatus) -> str:
    run = status.run
    parts = []
    if run.is_active and run.scan is not None:
        number = min(run.trials_committed + 1, run.trials_planned)
        parts.append(f"{run.scan.stage}, scan {number} of {run.trials_planned}")
        if run.scan.attempt > 1:
            parts.append(f"attempt {run.scan.attempt}")
    if status.simulated:
        parts.append("SIMULATED")
    return " · ".join(parts)
