"""A cell of a health strip: a figure with its verdict, and the readings that strips share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from PySide6.QtCore import QEvent, QTimer
from PySide6.QtGui import QHideEvent, QResizeEvent, QShowEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QWidget

from gui.widgets.formatting import age, ago, size
from gui.widgets.labels import elastic, label, set_property
from gui.widgets.layouts import hbox, vbox
from gui.widgets.status_lamp import Level, StatusLamp
from gui.widgets.theme import text_scale
from rigctl.acquisition.rpc.messages import RecordingStatus

VERDICTS_PX = 1240
_CELL_GAP_PX, _SIDES_PX = 2, 16
_TEXT_CHANGES = (QEvent.Type.FontChange, QEvent.Type.StyleChange)
DISK_HOURS_LIMIT = 1.0
DISK_FREE_LIMIT_BYTES = 2_000_000_000
RECENT_LOSS_S = 60.0
"""So long after a loss the figure is BAD."""


class Reading(NamedTuple):
    """Text and verdict of one cell; ``short``: a text for a cell that the first does not fit."""

    text: str
    level: Level
    short: str = ""


class CellSpec(NamedTuple):
    """Name, stretch (the width in pixels in the smallest window) and tooltip of a cell."""

    name: str
    stretch: int
    tooltip: str


class HealthCell(QFrame):
    """Name, value with unit, verdict in words, and a lamp."""

    def __init__(self, spec: CellSpec) -> None:
        super().__init__()
        self.setProperty("role", "card")
        self.setToolTip(spec.tooltip)
        self.lamp = StatusLamp(13)
        self.verdict = label("", "muted")
        self.value = elastic(label("–", "value"))
        grid = QGridLayout(self)
        grid.setContentsMargins(4, 3, 4, 3)
        grid.setVerticalSpacing(0)
        grid.setHorizontalSpacing(2)
        grid.addWidget(label(spec.name, "muted"), 0, 0)
        grid.addWidget(self.verdict, 0, 1)
        grid.addWidget(self.lamp, 0, 2)
        grid.addWidget(self.value, 1, 0, 1, 3)
        grid.setColumnStretch(0, 1)

    def show_reading(self, reading: Reading) -> None:
        """Show a value and its verdict."""
        self.value.setText(self._fitting(reading))
        self.lamp.set_level(reading.level)
        self.verdict.setText("" if reading.level is Level.OFF else reading.level.value.upper())
        is_alert = reading.level in (Level.WARN, Level.BAD)
        set_property(self.verdict, "role", reading.level.value if is_alert else "muted")
        set_property(self.value, "level", reading.level.value)
        set_property(self, "level", reading.level.value)

    def _fitting(self, reading: Reading) -> str:
        """Return the text, or the short one where the text is too wide."""
        needs_px = self.value.fontMetrics().horizontalAdvance(reading.text)
        return reading.short if reading.short and needs_px > self.value.width() else reading.text


class HealthRow(QWidget):
    """A row with a cell for each figure; two lines where the texts are too large for one."""

    def __init__(self, specs: Mapping[str, CellSpec]) -> None:
        super().__init__()
        self._stretches = {key: spec.stretch for key, spec in specs.items()}
        self._lines = (hbox(spacing=2), hbox(spacing=2))
        self._n_lines = 0
        self.setLayout(vbox(*self._lines, spacing=2, margins=(8, 0, 8, 0)))
        self.cells = {key: HealthCell(spec) for key, spec in specs.items()}
        self._fill_lines(1)
        self.setMinimumWidth(1)  # a strip that another one hides must not widen the window
        self.show_nothing()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the cells in a turn of its own: a second line takes its height from the plots."""
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._fit)

    def showEvent(self, event: QShowEvent) -> None:
        """Take a second line if it is needed."""
        super().showEvent(event)
        self._fit()

    def hideEvent(self, event: QHideEvent) -> None:
        """Take no more height than one line behind another strip."""
        super().hideEvent(event)
        self._fill_lines(1)

    def changeEvent(self, event: QEvent) -> None:
        """Follow another size of the texts."""
        super().changeEvent(event)
        if hasattr(self, "cells") and event.type() in _TEXT_CHANGES:
            self._fit()

    def _fit(self) -> None:
        """Use a second line, and leave the verdicts to the lamps, where the words do not fit."""
        width_px = self.width() / text_scale()
        needs_px = sum(self._stretches.values()) + _CELL_GAP_PX * (len(self.cells) - 1) + _SIDES_PX
        n_lines = 1 if width_px >= needs_px or not self.isVisible() else 2
        if n_lines != self._n_lines:
            self._fill_lines(n_lines)
        for cell in self.cells.values():
            cell.verdict.setHidden(width_px * n_lines < VERDICTS_PX)

    def _fill_lines(self, n_lines: int) -> None:
        """Share the cells among the lines in their order, so that both are about as long."""
        self._n_lines = n_lines
        most_px = sum(self._stretches.values()) / n_lines
        used_px = 0
        for key, cell in self.cells.items():
            line = self._lines[min(int(used_px / most_px), n_lines - 1)]
            line.addWidget(cell, self._stretches[key])
            used_px += self._stretches[key]

    def show_nothing(self) -> None:
        """Show that no figure is known."""
        for cell in self.cells.values():
            cell.show_reading(Reading("–", Level.OFF))

    def show_readings(self, readings: Mapping[str, Reading]) -> None:
        """Show readings with their verdicts."""
        for key, reading in readings.items():
            self.cells[key].show_reading(reading)


def judge(is_good: bool) -> Level:
    """Return OK or BAD."""
    return Level.OK if is_good else Level.BAD


def loss_reading(count: int, lost_age_s: float | None, connected: bool) -> Reading:
    """Return how many samples are lost: BAD while that is recent, then OK with its age."""
    number = f"{count}" if count < 10_000 else f"{count // 1000} k"
    if not connected or not count:
        return Reading(number, Level.OK if connected else Level.OFF)
    if lost_age_s is not None and lost_age_s <= RECENT_LOSS_S:
        return Reading(number, Level.BAD)
    earlier = f"{number} earlier"
    text = earlier if lost_age_s is None else f"{number}, {ago(lost_age_s)}"
    return Reading(text, Level.OK, earlier)


def loss_line(what: str, count: int, lost_age_s: float | None) -> str:
    """Return a sentence on all losses; ``what``: whose, in the plural."""
    if not count:
        return f"No {what} are lost."
    when = f", the last of them {ago(lost_age_s)}" if lost_age_s is not None else ""
    return f"{count} {what} are lost{when}."


def age_reading(age_s: float | None, limit_s: float, connected: bool) -> Reading:
    """Return an age that must be at most the limit; None before any data."""
    if age_s is None:
        return Reading("–", Level.OFF if connected else Level.BAD)
    return Reading(age(age_s), judge(connected and age_s <= limit_s))


def disk_reading(recording: RecordingStatus) -> Reading:
    """Return the free disk space and, while recording, how long it lasts."""
    if not recording.disk_free_bytes:
        return Reading("–", Level.OFF)
    free, hours = size(recording.disk_free_bytes), recording.hours_left
    if recording.active and hours is not None:
        left = f"{hours / 24:.0f} d" if hours >= 48 else f"{hours:.0f} h"
        return Reading(f"{free}, {left}", judge(hours > DISK_HOURS_LIMIT))
    return Reading(free, judge(recording.disk_free_bytes > DISK_FREE_LIMIT_BYTES))
