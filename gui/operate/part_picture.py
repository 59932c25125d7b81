"""What a part of the setup is about: its box in the wiring drawing, or the load cell's course."""

from __future__ import annotations

from collections import deque
from math import ceil, floor

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.widgets.labels import label
from gui.widgets.layouts import EventWatch
from gui.widgets.plot_axes import LEFT_PX, PlotGrid, fixed_plot, reserve
from gui.widgets.theme import applied_theme, scaled_px
from rigctl.config.resources import part_title, wiring_drawing
from rigctl.engine.rpc.messages import EngineStatus

MARGIN = 8.0
SHOWN_S = 30.0
LEAST_SPAN_G = 20.0
LEAST_TRACE_PX, TRACE_HEIGHT_PX = 160, 115
TRACE_TITLE = "Load cell (g), last 30 s"


class PartDrawing(QWidget):
    """One part of a wiring drawing at the largest undistorted size, on white."""

    def __init__(self) -> None:
        super().__init__()
        self._pages: dict[str, QSvgRenderer] = {}
        self._picture = ""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        """Return a size at which the names of the pins can be read."""
        return QSize(scaled_px(460), scaled_px(190))

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size that shows anything."""
        return QSize(scaled_px(160), scaled_px(90))

    def show_part(self, picture: str) -> None:
        """Show a part, ``page#id``, or nothing."""
        if picture != self._picture:
            self._picture = picture
            self.setAccessibleName(f"Wiring: {part_title(picture)}" if picture else "")
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the part in the middle."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        page, _, part = self._picture.partition("#")
        drawing = self._drawing(page)
        if not drawing.isValid():
            return
        room = QRectF(self.rect()).adjusted(MARGIN, MARGIN, -MARGIN, -MARGIN)
        shown = drawing.boundsOnElement(part).size()
        place = QRectF(QPointF(), shown.scaled(room.size(), Qt.AspectRatioMode.KeepAspectRatio))
        place.moveCenter(room.center())
        drawing.render(painter, part, place)

    def _drawing(self, page: str) -> QSvgRenderer:
        """Return a page of the drawing, which is read once."""
        if page not in self._pages:
            self._pages[page] = QSvgRenderer(str(wiring_drawing(page)) if page else "")
        return self._pages[page]


class CellTrace(PlotGrid):
    """The load cell's reading over the last half minute, with its range at the left."""

    def __init__(self) -> None:
        super().__init__(label(TRACE_TITLE, "muted"))
        self._points: deque[tuple[float, float]] = deque()
        self.setAccessibleName(TRACE_TITLE)
        self.graphics.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._plot = fixed_plot(self.cells, 0, 0)
        reserve(self._plot, "left", LEFT_PX)
        self._plot.setXRange(-SHOWN_S, 0.0, padding=0)
        self._plot.getAxis("bottom").setTicks([[], []])
        self._curve = pg.PlotCurveItem(antialias=True)
        self._plot.addItem(self._curve)
        self.graphics.setMinimumWidth(LEAST_TRACE_PX)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._colour()
        EventWatch(self, self._colour, QEvent.Type.PaletteChange, QEvent.Type.FontChange)

    def add(self, status: EngineStatus) -> None:
        """Add the newest reading."""
        points, at_s = self._points, status.at_s
        if points and at_s < points[-1][0]:
            points.clear()  # of another engine
        points.append((at_s, status.force_g))
        while at_s - points[0][0] > SHOWN_S:
            points.popleft()
        if self.isVisible():
            self._draw()

    def _draw(self) -> None:
        time_s, force_g = np.array(self._points).T
        low_g, high_g = force_g.min(), force_g.max()
        half_g = max(LEAST_SPAN_G, 1.1 * (high_g - low_g)) / 2
        middle_g = (low_g + high_g) / 2
        ends_g = floor(middle_g - half_g), ceil(middle_g + half_g)
        self._plot.setYRange(*ends_g, padding=0)
        self._plot.getAxis("left").setTicks([[(end, f"{end}") for end in ends_g], []])
        self._curve.setData(time_s - time_s[-1], force_g)

    def _colour(self) -> None:
        theme = applied_theme()
        self.graphics.setFixedHeight(scaled_px(TRACE_HEIGHT_PX))  # the drawing needs the rest
        self.colour(theme, self._plot)
        self._plot.getViewBox().setBorder(theme.line)
        self._curve.setPen(pg.mkPen(theme.accent, width=1.5))
