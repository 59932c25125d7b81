"""The finger's part of the middle of the window: task, plate, plots, answer, confusion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen, QPolygonF, QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QSizePolicy, QWidget

from gui.finger.scan_plots import AnswerState, ScanPlots, ScanRecord, velocity_title
from gui.widgets.formatting import capitalised
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import EventWatch, container, hbox, scroll_area, vbox
from gui.widgets.theme import Theme, applied_theme, blend, scaled_px
from rigctl.engine.rpc.messages import reason_words
from rigctl.finger.live_file import FingerLiveReader
from rigctl.finger.status import FingerEngineStatus, FingerRunStatus
from rigctl.finger.values import MARKS_MM, PLATE_MM, PredictionRow
from rigctl.values import PLATE_WIDTH_MM

_LINE_PX, _ONE_LINE_PX = 20, 330
"""Height of a line of text, and the width in which title and position share one."""
_ALONG_MM, _ACROSS_MM = 18.0, 6.0
"""Shown before and after the plate, and beside it: the finger begins and ends there."""
_SHOWN_MM = (PLATE_MM + 2 * _ALONG_MM, PLATE_WIDTH_MM + 2 * _ACROSS_MM)
_MAX_PLATE_PX = 170
_MAX_POINTS = 400
_FINGER_PX = 7.0
_TICK_MM = 50


class PlateView(QWidget):
    """Draws the plate, the path of the present slide and the finger.

    A filled disc touches the plate, a ring is lifted, a cross is a tracker that lost its reference.
    """

    def __init__(self) -> None:
        super().__init__()
        self.path_mm = np.zeros((0, 2))
        self._texture = ""
        self._status = FingerEngineStatus()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        EventWatch(self, self._take_height, QEvent.Type.Resize, QEvent.Type.FontChange)

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show position and contact."""
        self._status = status
        scan = status.run.scan
        self._texture = scan.texture if scan is not None else ""
        self.update()

    def show_path(self, along_mm: NDArray[np.float64], across_mm: NDArray[np.float64]) -> None:
        """Show the valid positions of the slide so far, mm, (n,)."""
        step = max(1, -(-len(along_mm) // _MAX_POINTS))
        path = np.column_stack([along_mm, across_mm])
        self.path_mm = np.concatenate([path[::step], path[-1:]])
        self.update()

    @property
    def words(self) -> str:
        """What the tracker and the sensor say, in words and mm."""
        status = self._status
        if not status.tracker_connected or status.position_age_s is None:
            return "no position"
        if not status.position_valid:
            return "tracker lost"
        place = f"along {status.along_mm:.0f} mm, across {status.across_mm:+.0f} mm"
        contact = "in contact" if status.in_contact else "not in contact"
        return f"{contact}, {place}".replace("-", "−")

    def _take_height(self) -> None:
        """Take the height at which the plate fills the width, with its texts."""
        plate_px = min(self.width() * _SHOWN_MM[1] / _SHOWN_MM[0], _MAX_PLATE_PX)
        self.setFixedHeight(round(plate_px) + self._title_px + scaled_px(_LINE_PX))

    @property
    def _title_px(self) -> int:
        lines = 1 if self.width() >= scaled_px(_ONE_LINE_PX) else 2
        return lines * scaled_px(_LINE_PX)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw everything in the colours of the applied theme."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._set_scale()
        self._paint_title(painter, theme)
        self._paint_plate(painter, theme)
        self._paint_path(painter, theme)
        if self._status.position_age_s is not None:
            self._paint_finger(painter, theme)

    def _set_scale(self) -> None:
        width_mm, height_mm = _SHOWN_MM
        room_px = self.height() - self._title_px - scaled_px(_LINE_PX)
        self._px_per_mm = min(self.width() / width_mm, room_px / height_mm)
        self._left_px = (self.width() - PLATE_MM * self._px_per_mm) / 2
        self._middle_px = self._title_px + room_px / 2

    def _at(self, along_mm: float, across_mm: float) -> QPointF:
        """Return a place on the widget; left of the way is up, as seen from above."""
        return QPointF(
            self._left_px + along_mm * self._px_per_mm,
            self._middle_px - across_mm * self._px_per_mm,
        )

    def _paint_title(self, painter: QPainter, theme: Theme) -> None:
        plate = f"Plate {self._texture}" if self._texture else "Plate"
        title = f"{plate} from above, {PLATE_MM:.0f} × {PLATE_WIDTH_MM:.0f} mm"
        line_px = scaled_px(_LINE_PX)
        first = QRectF(4, 0, self.width() - 8, line_px)
        last = first.translated(0, self._title_px - line_px)
        advance, share_line = painter.fontMetrics().horizontalAdvance, first == last
        if advance(title) + share_line * (advance(self.words) + 8) > first.width():
            title = plate
        side = Qt.AlignmentFlag.AlignRight if share_line else Qt.AlignmentFlag.AlignLeft
        painter.setPen(QColor(theme.muted))
        painter.drawText(first, Qt.AlignmentFlag.AlignVCenter, title)
        painter.setPen(QColor(theme.text))
        painter.drawText(last, side | Qt.AlignmentFlag.AlignVCenter, self.words)

    def _paint_plate(self, painter: QPainter, theme: Theme) -> None:
        half = PLATE_WIDTH_MM / 2
        painter.setPen(QPen(QColor(theme.line), 1.5))
        painter.setBrush(QColor(theme.plot))
        painter.drawRoundedRect(QRectF(self._at(0, half), self._at(PLATE_MM, -half)), 3, 3)
        begin, end = MARKS_MM
        inside = QRectF(self._at(begin, half), self._at(end, -half))
        painter.fillRect(inside, QColor(blend(theme.accent, theme.plot, 0.12)))
        painter.setPen(QPen(QColor(theme.accent), 1.5, Qt.PenStyle.DashLine))
        for mark in MARKS_MM:
            painter.drawLine(self._at(mark, half + 4), self._at(mark, -half - 4))
        painter.setPen(QColor(theme.muted))
        self._paint_ticks(painter)

    def _paint_ticks(self, painter: QPainter) -> None:
        """Draw the texts below the plate: the marks first, others where there is room."""
        ticks = range(0, round(PLATE_MM) + 1, _TICK_MM)
        drawn: list[QRectF] = []
        line_px = scaled_px(_LINE_PX)
        for tick in sorted(ticks, key=lambda tick: tick not in MARKS_MM):
            text = _tick_text(tick)
            width = painter.fontMetrics().horizontalAdvance(text) + 2
            left = min(max(self._at(tick, 0).x() - width / 2, 0), self.width() - width)
            area = QRectF(left, self.height() - line_px, width, line_px)
            if not any(area.adjusted(-4, 0, 4, 0).intersects(other) for other in drawn):
                painter.drawText(area, Qt.AlignmentFlag.AlignCenter, text)
                drawn.append(area)

    def _paint_path(self, painter: QPainter, theme: Theme) -> None:
        if len(self.path_mm) < 2:
            return
        painter.setPen(QPen(QColor(theme.groups[1]), 1.6))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawPolyline(QPolygonF([self._at(x, y) for x, y in self.path_mm.tolist()]))

    def _paint_finger(self, painter: QPainter, theme: Theme) -> None:
        status, r = self._status, _FINGER_PX
        area = QRectF(self.rect()).adjusted(r, self._title_px, -r, -scaled_px(_LINE_PX))
        newest = self.path_mm[-1].tolist() if len(self.path_mm) and status.position_valid else None
        place = self._at(*(newest or (status.along_mm, status.across_mm)))
        x = min(max(place.x(), area.left()), area.right())
        y = min(max(place.y(), area.top()), area.bottom())
        painter.setPen(QPen(QColor(theme.text if status.position_valid else theme.bad), 2.0))
        if not status.position_valid:
            painter.drawLine(QPointF(x - r, y - r), QPointF(x + r, y + r))
            painter.drawLine(QPointF(x - r, y + r), QPointF(x + r, y - r))
            return
        painter.setBrush(QColor(theme.groups[1]) if status.in_contact else Qt.BrushStyle.NoBrush)
        painter.drawEllipse(QPointF(x, y), r, r)


def _tick_text(tick_mm: int) -> str:
    names = dict(zip(MARKS_MM, ("start", "end"), strict=True))
    name = names.get(float(tick_mm))
    return f"{name} {tick_mm} mm" if name else f"{tick_mm} mm"


_AXIS_PX = 22
_LEAST_CELL_PX = 18
_LEAST_SIZE_PX = 150, 130


class ConfusionMatrix(QWidget):
    """Rows are the plates, columns the answers; right ones are on the framed diagonal."""

    def __init__(self) -> None:
        super().__init__()
        self._run = FingerRunStatus()

    def show_run(self, run: FingerRunStatus) -> None:
        """Show the counts of a run."""
        if (run.textures, run.confusion) != (self._run.textures, self._run.confusion):
            self._run = run
            self.updateGeometry()
            self.update()

    def minimumSizeHint(self) -> QSize:
        """Return the size in which each cell has room for its number."""
        cells_px = 2 * _AXIS_PX + _LEAST_CELL_PX * len(self._run.textures)
        return QSize(*(scaled_px(max(cells_px, least)) for least in _LEAST_SIZE_PX))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw names and cells."""
        painter, theme = QPainter(self), applied_theme()
        names = self._run.textures
        if not names:
            return
        axis = scaled_px(_AXIS_PX)
        side = (min(self.width(), self.height()) - 2 * axis) / len(names)
        self._paint_axes(painter, names, side)
        most = max(
            (max(row.values(), default=0) for row in self._run.confusion.values()), default=0
        )
        for i, true in enumerate(names):
            for j, named in enumerate(names):
                count = self._run.confusion.get(true, {}).get(named, 0)
                place = QRectF(2 * axis + j * side, 2 * axis + i * side, side, side)
                cell = place.adjusted(1, 1, -1, -1)
                colour = theme.ok if i == j else theme.bad
                share = 0.55 * count / most if most else 0.0
                painter.fillRect(cell, QColor(blend(colour, theme.plot, share)))
                painter.setPen(QPen(QColor(theme.text if i == j else theme.line), 1))
                painter.drawRect(cell)
                painter.setPen(QColor(theme.text if count else theme.muted))
                painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, f"{count}")

    def _paint_axes(self, painter: QPainter, names: tuple[str, ...], side: float) -> None:
        theme, centre = applied_theme(), Qt.AlignmentFlag.AlignCenter
        length, axis = len(names) * side, scaled_px(_AXIS_PX)
        painter.setPen(QColor(theme.muted))
        painter.drawText(QRectF(2 * axis, 0, length, axis), centre, "named")
        painter.save()
        painter.translate(0, 2 * axis + length)
        painter.rotate(-90)
        painter.drawText(QRectF(0, 0, length, axis), centre, "plate")
        painter.restore()
        painter.setPen(QColor(theme.text))
        for place, name in enumerate(names):
            start = 2 * axis + place * side
            painter.drawText(QRectF(start, axis, side, axis), centre, name)
            painter.drawText(QRectF(axis, start, axis, side), centre, name)


class ConfusionView(QWidget):
    """The accuracy in words above the matrix."""

    def __init__(self) -> None:
        super().__init__()
        self.accuracy, self.matrix = elastic(label("", "heading")), ConfusionMatrix()
        column = vbox(self.accuracy, spacing=2)
        column.addWidget(self.matrix, 1)
        self.setLayout(column)
        self.show_run(FingerRunStatus())

    def show_run(self, run: FingerRunStatus) -> None:
        """Show the answers of a run so far."""
        show_text(self.accuracy, accuracy_words(run))
        self.matrix.show_run(run)


def accuracy_words(run: FingerRunStatus) -> str:
    """Return the running accuracy beside that of guessing."""
    if not run.classified:
        return "Right: no scan is named yet"
    share = f"{run.correct / run.classified:.0%}"
    chance = f", guessing {1 / len(run.textures):.0%}" if run.textures else ""
    return f"Right: {run.correct} of {run.classified} ({share}{chance})".replace("%", "\u202f%")


ROW_PX = 22
_TITLE_PX = 18
_LEAST_ROWS, _LEAST_ROW_PX = 5, 18
_NAME_PX, _VALUE_PX, _LEAST_BAR_PX = 26, 106, 50


class ProbabilityBars(QWidget):
    """One row a texture, in a fixed order. A frame and a word mark the set."""

    def __init__(self) -> None:
        super().__init__()
        self.probabilities: dict[str, float] = {}
        self._textures: tuple[str, ...] = ()
        self._set: tuple[str, ...] = ()
        self._named = ""

    def show_record(self, record: ScanRecord) -> None:
        """Show the newest answer, or none."""
        row = record.prediction
        self.probabilities = dict(row.probabilities) if row is not None else {}
        self._set = tuple(row.texture_set) if row is not None else ()
        self._named = row.texture if row is not None else ""
        self.updateGeometry()
        self.update()

    def show_textures(self, textures: tuple[str, ...]) -> None:
        """Show rows for the textures of a protocol, also before there is an answer."""
        if textures != self._textures:
            self._textures = textures
            self.updateGeometry()
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw title and rows."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setPen(QColor(theme.muted))
        title_px = scaled_px(_TITLE_PX)
        title = QRectF(0, 0, self.width(), title_px)
        painter.drawText(title, Qt.AlignmentFlag.AlignVCenter, "Probability, and the set")
        names = self._names()
        room_px = (self.height() - title_px) / max(len(names), 1)
        height = min(room_px, 1.4 * scaled_px(ROW_PX))
        for place, name in enumerate(names):
            self._paint_row(painter, name, title_px + place * height, height)

    def _names(self) -> tuple[str, ...]:
        return tuple(sorted(self.probabilities)) or self._textures

    def minimumSizeHint(self) -> QSize:
        """Return rows as high as their text; the column scrolls where there is no room."""
        rows_px = max(_LEAST_ROWS * ROW_PX, len(self._names()) * _LEAST_ROW_PX)
        width_px = _NAME_PX + _LEAST_BAR_PX + _VALUE_PX
        return QSize(scaled_px(width_px), scaled_px(_TITLE_PX + rows_px))

    def _paint_row(self, painter: QPainter, name: str, top: float, height: float) -> None:
        theme, share = applied_theme(), self.probabilities.get(name)
        font = QFont(self.font())
        font.setBold(name == self._named)
        painter.setFont(font)
        painter.setPen(QColor(theme.text))
        middle = Qt.AlignmentFlag.AlignVCenter
        name_px, value_px = scaled_px(_NAME_PX), scaled_px(_VALUE_PX)
        painter.drawText(QRectF(0, top, name_px, height), middle, name)
        bar = QRectF(name_px, top + 3, self.width() - name_px - value_px, height - 6)
        painter.fillRect(bar, QColor(blend(theme.muted, theme.panel, 0.15)))
        if share is None:
            return
        filled = QRectF(bar.left(), bar.top(), bar.width() * share, bar.height())
        is_inside = name in self._set
        painter.fillRect(filled, QColor(theme.accent if is_inside else theme.set_point))
        if is_inside:
            painter.setPen(QPen(QColor(theme.text), 1.2))
            painter.drawRect(bar)
        text = f"{share:.1%}".replace("%", "\u202f%") + (" in set" if is_inside else "")
        place = QRectF(bar.right() + 6, top, value_px - 6, height)
        painter.setPen(QColor(theme.text))
        painter.drawText(place, middle, text)


_MARKS = {
    AnswerState.NONE: "",
    AnswerState.GROWING: "…",
    AnswerState.RIGHT: "✓",
    AnswerState.WRONG: "✗",
    AnswerState.UNKNOWN: "⚠",
}


class AnswerView(QFrame):
    """A frame whose background is the verdict, as in the paper's demonstration.

    Marks and words say the same as the colour.
    """

    painted = Signal(int, float)
    """Scan and time of sending of the velocity, after an answer to it is on the screen."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "answer")
        self.caption, self.verdict = elastic(label("", "muted")), label("", "verdict", wraps=True)
        self.mark, self.letter = label("", "mark"), label("", "letter")
        self.decision, self.texture_set = elastic(label("", "")), elastic(label("", ""))
        for text in (self.mark, self.letter):
            text.setAlignment(Qt.AlignmentFlag.AlignCenter)
        answer = hbox(self.letter, self.mark, self.verdict, wide=2, spacing=12)
        column = vbox(self.caption, spacing=1, margins=(10, 6, 10, 6))
        column.addLayout(answer, 1)
        column.addWidget(self.decision)
        column.addWidget(self.texture_set)
        self.setLayout(column)
        self.coverage = FingerRunStatus().coverage
        """Share of the sets that hold the true texture."""
        self._unpainted: tuple[int, float] | None = None
        self.show_record(ScanRecord())

    @property
    def state(self) -> str:
        """The verdict that is shown."""
        return str(self.property("verdict"))

    def show_record(self, record: ScanRecord, sent_s: float | None = None) -> None:
        """Show the newest answer; ``sent_s``: when the velocity that led to it was sent."""
        row, state = record.prediction, record.state
        set_property(self, "verdict", state.value)
        show_text(self.mark, _MARKS[state])
        show_text(self.letter, "–" if row is None else _letter(row))
        show_text(self.caption, _caption(record))
        show_text(self.verdict, _verdict_words(record))
        show_text(self.decision, _decision_words(record))
        show_text(self.texture_set, "" if row is None else _set_words(row, self.coverage))
        if row is not None and sent_s is not None:
            self._unpainted = (row.scan, sent_s)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint, and report an answer that was not on the screen before."""
        super().paintEvent(event)
        if self._unpainted is not None:
            scan_and_time, self._unpainted = self._unpainted, None
            self.painted.emit(*scan_and_time)


def _letter(row: PredictionRow) -> str:
    return row.texture if row.known else "?"


def _caption(record: ScanRecord) -> str:
    row = record.prediction
    if record.scan < 0:
        return "No scan yet"
    scan = f"Scan {record.asked.trial_id}" if record.asked.trial_id else "This scan"
    if row is None:
        return scan
    windows = f"{row.windows} window{'s' if row.windows > 1 else ''}"
    return f"{scan}: {row.distance_mm:.0f} mm, {row.seconds:.1f} s, {windows}"


def _verdict_words(record: ScanRecord) -> str:
    """Return the verdict in words."""
    row, state = record.prediction, record.state
    if row is None:
        return "The answer appears here while the finger moves" if record.scan < 0 else "no answer"
    share = row.probabilities.get(row.texture, 0.0)
    if not row.known:
        return f"not one of these; nearest is {row.texture} ({share:.0%})".replace("%", "\u202f%")
    words = {
        AnswerState.GROWING: "so far",
        AnswerState.RIGHT: "right",
        AnswerState.WRONG: f"wrong: the plate is {record.asked.texture}",
    }[state]
    return f"{words} ({share:.0%})".replace("%", "\u202f%")


def _decision_words(record: ScanRecord) -> str:
    """Return after how many s and mm the answer was sure."""
    sure = record.first_sure
    if record.prediction is None:
        return ""
    if sure is None:
        return "Not sure at the end" if record.prediction.is_final else "Not sure yet"
    return f"Sure of {sure.texture} after {sure.seconds:.2f} s, {sure.distance_mm:.0f} mm"


def _set_words(row: PredictionRow, coverage: float) -> str:
    """Return the set of textures; one with all of them says nothing."""
    names, total = ", ".join(row.texture_set) or "none", len(row.probabilities)
    share = f"{coverage:.0%}".replace("%", "\u202f%")
    return f"{share} set: {names} ({len(row.texture_set)} of {total})"


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
        self._is_running = False
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
        if run.is_active != self._is_running:
            self._is_running = run.is_active
            self._show_notice()
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
        self._show_notice()

    def _show_notice(self) -> None:
        """Say during a run why its last attempt does not count: the scan is made again."""
        reasons = "; ".join(self.record.reasons) if self._is_running else ""
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
        left = vbox(self.plate, self.velocity_title, self.plots, spacing=3, tall=2)
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
        parts.append(f"{run.scan.stage}, scan {run.scan.trial_id} of {run.trials_planned}")
        if run.scan.attempt > 1:
            parts.append(f"attempt {run.scan.attempt}")
    if status.simulated:
        parts.append("SIMULATED")
    return " · ".join(parts)
