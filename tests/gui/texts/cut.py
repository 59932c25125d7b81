"""Find the texts of a window that are clipped, shortened or off the screen."""

from __future__ import annotations

from PySide6.QtCore import QPoint, QRect, QSize, Qt
from PySide6.QtWidgets import (
    QAbstractScrollArea,
    QDockWidget,
    QGraphicsView,
    QHeaderView,
    QLabel,
    QScrollArea,
    QTableView,
    QTreeView,
    QWidget,
)

from tests.gui.texts.painted import painted_texts
from tests.gui.texts.piece import SLACK_PX, CutText, lacks, path_of
from tests.gui.texts.plots import cut_plot_texts
from tests.gui.texts.widgets import pieces


def cut_texts(window: QWidget) -> list[CutText]:
    """Return all texts of the window that cannot be read whole where they stand."""
    with painted_texts() as painted:
        window.grab()
        for area in window.findChildren(QScrollArea):
            if area.isVisible():
                _paint_hidden(area)
    found = list(painted)
    behind = {
        child
        for dock in window.findChildren(QDockWidget)
        if _is_behind(dock)
        for child in (dock, *dock.findChildren(QWidget))
    }
    for widget in (window, *window.findChildren(QWidget)):
        if widget in behind or not widget.isVisibleTo(window):
            continue
        if isinstance(widget, QGraphicsView):
            found += cut_plot_texts(widget)
        else:
            found += _cut_pieces(widget)
    return sorted(set(found))


def _paint_hidden(area: QScrollArea) -> None:
    """Let the widgets paint that paint texts themselves and are scrolled out of sight."""
    port = area.viewport()
    for child in area.widget().findChildren(QWidget):
        is_own = type(child).__module__.startswith("gui.") and "paintEvent" in vars(type(child))
        if (is_own or isinstance(child, QGraphicsView)) and child.isVisible():
            place = QRect(child.mapTo(port, QPoint(0, 0)), child.size())
            if not port.rect().contains(place):
                child.grab()


def _is_behind(dock: QDockWidget) -> bool:
    """Return whether another tab hides a dock; Qt then puts it outside its parent."""
    return not dock.parentWidget().rect().intersects(dock.geometry())


def _cut_pieces(widget: QWidget) -> list[CutText]:
    found, where = [], path_of(widget)
    for piece in pieces(widget):
        if not piece.fits:
            found.append(CutText(where, piece.text, lacks(piece.needs, piece.place.size())))
            continue
        hidden = _hidden_by(widget, _in_view(widget, piece.shown_in(widget, _alignment(widget))))
        if hidden:
            found.append(CutText(where, piece.text, hidden))
    return found


def _alignment(widget: QWidget) -> Qt.AlignmentFlag:
    if isinstance(widget, QLabel):
        return widget.alignment()
    return Qt.AlignmentFlag.AlignCenter


def _in_view(widget: QWidget, rect: QRect) -> QRect:
    """Return the pixels after scrolling a table to them; its header scrolls with it."""
    view = widget.parentWidget() if isinstance(widget, QHeaderView) else widget
    never = Qt.ScrollBarPolicy.ScrollBarAlwaysOff
    if not isinstance(view, QTableView | QTreeView) or view.horizontalScrollBarPolicy() is never:
        return rect
    port = widget if widget is not view else view.viewport()
    shown = rect.intersected(port.rect())
    return port.rect() if shown.isEmpty() else shown


def _hidden_by(widget: QWidget, rect: QRect) -> str:
    """Return which parent neither shows the pixels nor can be scrolled to them; empty if none."""
    origin, parent = rect, widget
    while not parent.isWindow():
        origin = origin.translated(parent.pos())
        above = parent.parentWidget()
        if above is None:
            return ""
        origin = _scrolled(above, origin)
        if not above.rect().adjusted(-SLACK_PX, -SLACK_PX, SLACK_PX, SLACK_PX).contains(origin):
            name, (width, height) = type(above).__name__, above.size().toTuple()
            at = f"({origin.left()}, {origin.top()}) to ({origin.right()}, {origin.bottom()})"
            return f"lies beyond the edge of its {name}: {at} of {width} × {height} px"
        parent = above
    return ""


def _scrolled(port: QWidget, rect: QRect) -> QRect:
    """Return the pixels after scrolling to them, as far as the area has scroll bars."""
    area = port.parentWidget()
    if not isinstance(area, QAbstractScrollArea) or area.viewport() is not port:
        return rect
    never = Qt.ScrollBarPolicy.ScrollBarAlwaysOff
    size, at = QSize(rect.size()), QPoint(rect.topLeft())
    if area.verticalScrollBarPolicy() is not never:
        size.setHeight(min(size.height(), port.height()))
        at.setY(0)
    if area.horizontalScrollBarPolicy() is not never:
        size.setWidth(min(size.width(), port.width()))
        at.setX(0)
    return QRect(at, size)
