"""Mouse and keys on the live plots: drag, wheel and arrows move, a click sets the reference."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent, QWheelEvent

from gui.live.live_data import LiveData, ValueScale
from gui.live.live_plots import LivePlots
from gui.live.sample_history import TimeWindow
from gui.live.time_plots import SetPointPlot
from rigctl.values import SAMPLE_RATE_HZ

HINT = "Point at the plots for values · click: reference · drag: move · wheel, Ctrl+wheel: zoom"


def cursor_text(
    data: LiveData, window: TimeWindow, position: int | None, taxel: int, scale: ValueScale
) -> str:
    """Return the values at a position; a hint without one."""
    if position is None:
        return HINT
    parts = [f"Cursor {_signed((position - window.origin) / SAMPLE_RATE_HZ, 3)} s"]
    if (drum := data.drum.at(position)) is not None:
        parts += [f"force {drum['force_g']:.1f} g", f"speed {drum['speed_mm_s']:.1f} mm/s"]
    reading = data.reading_at(position, taxel)
    shown = "no sample" if reading is None else f"{scale.text(reading)} {scale.unit}"
    parts.append(f"T{taxel + 1} {shown}")
    near = data.marks.nearest(position, window.span // 100)
    return " · ".join(parts + ([near.text] if near is not None else [])).replace(" -", " −")


def difference_text(
    data: LiveData, position: int | None, reference: int | None, taxel: int, scale: ValueScale
) -> str:
    """Return what changed from the reference to a position; empty without both."""
    if position is None or reference is None:
        return ""
    parts = [f"From the reference {_signed((position - reference) / SAMPLE_RATE_HZ, 3)} s"]
    drums = [data.drum.at(reference), data.drum.at(position)]
    if drums[0] is not None and drums[1] is not None:
        parts.append(f"{_signed(drums[1]['force_g'] - drums[0]['force_g'], 1)} g")
        parts.append(f"{_signed(drums[1]['speed_mm_s'] - drums[0]['speed_mm_s'], 1)} mm/s")
    readings = [data.reading_at(at, taxel) for at in (reference, position)]
    if readings[0] is not None and readings[1] is not None:
        change = scale.text(readings[1] - readings[0], signed=True)
        parts.append(f"T{taxel + 1} {change} {scale.unit}")
    first, last = sorted((reference, position))
    counts = _spikes_between(data, first, last, taxel)
    return " · ".join([*parts, f"SA {counts[0]}, RA {counts[1]} spikes"])


def _spikes_between(data: LiveData, first: int, last: int, taxel: int) -> tuple[int, int]:
    spikes = data.spikes_before(last, last - first + 1)
    n_taxels = spikes.shape[1] // 2
    columns = spikes[:, [taxel, n_taxels + taxel]].sum(axis=0, dtype=np.int64)
    return int(columns[0]), int(columns[1])


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


ZOOM = 1.25
DRAG_PX = 4
_Key = Qt.Key


class Pointer(QObject):
    """Turns the events of the plots into moves of time window and cursors.

    ``taxel``: the one whose readings the cursor shows, from 0.
    """

    taxel_changed = Signal(int)
    """The taxel under a click, or chosen by key."""
    enlarge_requested = Signal(int)
    """The taxel to show alone, or not alone if it is."""

    def __init__(self, plots: LivePlots) -> None:
        super().__init__(plots)
        self._plots, self.taxel = plots, 0
        self._press: tuple[QPointF, int] | None = None
        self._is_drag = False
        self._axis: tuple[SetPointPlot, tuple[float, float] | None] | None = None
        """Force or speed whose axis the mouse drags, and the part that it showed before."""
        graphics = plots.graphics
        graphics.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        graphics.setMouseTracking(True)
        graphics.viewport().setMouseTracking(True)
        graphics.viewport().installEventFilter(self)
        graphics.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take the events that move; pyqtgraph gets all others."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            return watched is self._plots.graphics and self._press_key(event)
        if watched is self._plots.graphics:
            return False
        if isinstance(event, QWheelEvent):
            return self._turn_wheel(event)
        if isinstance(event, QMouseEvent):
            return self._move_mouse(event)
        if event.type() == QEvent.Type.Leave:
            self._plots.cursors.share = None
            self._plots.draw_lines()
        return False

    def _move_mouse(self, event: QMouseEvent) -> bool:
        at, kind = event.position(), event.type()
        if kind == QEvent.Type.MouseMove:
            self._drag_or_point(at)
        elif kind == QEvent.Type.MouseButtonPress and event.button() == Qt.MouseButton.LeftButton:
            self._plots.graphics.setFocus(Qt.FocusReason.MouseFocusReason)
            self._press = (at, self._plots.navigation.window.right)
            found = self._plots.course_at(at)
            is_axis = found is not None and self._plots.share_at(at) is None
            self._axis = (found[0], found[0].part) if found is not None and is_axis else None
            self._is_drag = is_axis
        elif kind == QEvent.Type.MouseButtonRelease and self._press is not None:
            if not self._is_drag:
                self._click(at)
            self._press = None
        elif kind == QEvent.Type.MouseButtonDblClick:
            self._enlarge(at)
        return True

    def _enlarge(self, at: QPointF) -> None:
        """Show the taxel at a point alone, or the whole axis of force or speed there."""
        if self._choose_taxel(at):
            self.enlarge_requested.emit(self.taxel)
        elif (found := self._plots.course_at(at)) is not None:
            found[0].show_part(None)

    def _drag_or_point(self, at: QPointF) -> None:
        plots = self._plots
        if self._press is None:
            plots.cursors.share = plots.share_at(at)
            plots.draw_lines()
            return
        begin, right = self._press
        if self._axis is not None:
            course, part = self._axis
            course.show_part(part, (at.y() - begin.y()) / course.height_px)
            return
        if not self._is_drag and abs(at.x() - begin.x()) < DRAG_PX:
            return
        self._is_drag = True
        navigation = plots.navigation
        navigation.pause()
        navigation.move_to(right - round((at.x() - begin.x()) / plots.width_px * plots.span))
        plots.draw()

    def _click(self, at: QPointF) -> None:
        plots = self._plots
        plots.cursors.share = plots.share_at(at)
        plots.cursors.set_reference(plots.navigation.window)
        self._choose_taxel(at)
        plots.draw_lines()

    def _choose_taxel(self, at: QPointF) -> bool:
        taxel = self._plots.taxel_at(at)
        if taxel is not None:
            self._set_taxel(taxel)
        return taxel is not None

    def _set_taxel(self, taxel: int) -> None:
        self.taxel = taxel
        self.taxel_changed.emit(taxel)

    def _turn_wheel(self, event: QWheelEvent) -> bool:
        turn, share = event.angleDelta(), self._plots.share_at(event.position())
        navigation = self._plots.navigation
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier and turn.y():
            self._zoom_values(event.position(), 1 / ZOOM if turn.y() > 0 else ZOOM)
        elif event.modifiers() & Qt.KeyboardModifier.ShiftModifier or turn.x():
            navigation.scroll(round(-(turn.x() or turn.y()) / 1200 * self._plots.span))
        elif turn.y():
            navigation.zoom(1 / ZOOM if turn.y() > 0 else ZOOM, 0.5 if share is None else share)
        self._plots.draw()
        return True

    def _zoom_values(self, at: QPointF, factor: float) -> None:
        """Show ``factor`` times as many values of force or speed at a point, else of the traces."""
        if (found := self._plots.course_at(at)) is not None:
            course, share = found
            course.zoom(factor, share)
        else:
            self._plots.set_gain(self._plots.time_plots.traces.gain / factor)

    def _press_key(self, event: QKeyEvent) -> bool:
        plots, key = self._plots, event.key()
        navigation, span = plots.navigation, plots.span
        is_control = bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)
        if event.modifiers() & Qt.KeyboardModifier.AltModifier:
            return False
        if is_control and key in (_Key.Key_Left, _Key.Key_Right):
            step = max(1, span // max(1, round(plots.width_px)))
            plots.cursors.step(-step if key == _Key.Key_Left else step, navigation.window)
        elif is_control and key in (_Key.Key_Up, _Key.Key_Down):
            is_speed = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
            plots.time_plots.courses[is_speed].zoom(1 / ZOOM if key == _Key.Key_Up else ZOOM)
        elif key == _Key.Key_0:
            plots.show_whole_courses()
        elif key in (_Key.Key_Up, _Key.Key_Down):
            self._step_taxel(1 if key == _Key.Key_Down else -1)
        elif key in (_Key.Key_Return, _Key.Key_Enter):
            self.enlarge_requested.emit(self.taxel)
        elif key == _Key.Key_C:
            plots.cursors.set_reference(navigation.window)
        elif not self._press_time_key(key):
            return False
        plots.draw()
        plots.draw_lines()
        return True

    def _press_time_key(self, key: int) -> bool:
        navigation, span = self._plots.navigation, self._plots.span
        steps = {
            _Key.Key_Left: -span // 10, _Key.Key_Right: span // 10,
            _Key.Key_PageUp: -span, _Key.Key_PageDown: span,
        }  # fmt: skip
        if key in steps:
            navigation.scroll(steps[_Key(key)])
        elif key == _Key.Key_Space:
            navigation.toggle()
        elif key == _Key.Key_Home:
            navigation.scroll(navigation.oldest - navigation.window.right)
        elif key == _Key.Key_End:
            navigation.resume()
        elif key in (_Key.Key_Plus, _Key.Key_Equal, _Key.Key_Minus):
            navigation.zoom(ZOOM if key == _Key.Key_Minus else 1 / ZOOM)
        else:
            return False
        return True

    def _step_taxel(self, step: int) -> None:
        shown = self._plots.time_plots.taxels
        place = shown.index(self.taxel) if self.taxel in shown else 0
        self._set_taxel(shown[min(max(place + step, 0), len(shown) - 1)])
