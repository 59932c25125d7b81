"""A figure of a report that is sharp at every size."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QRectF, QSizeF, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPixmap
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QWidget

from gui.analysis.export.picture_file import Picture
from gui.widgets.labels import plain_tooltip
from gui.widgets.theme import Theme


class FigureView(QWidget):
    """An SVG or a PNG at the largest undistorted size, on white."""

    def __init__(self) -> None:
        super().__init__()
        self.pixmap, self.drawing = QPixmap(), QSvgRenderer()

    @property
    def is_shown(self) -> bool:
        """Whether there is a figure."""
        return self.drawing.isValid() or not self.pixmap.isNull()

    def show_file(self, path: str) -> None:
        """Show another figure: the SVG beside a PNG, if there is one."""
        drawing = Path(path).with_suffix(".svg")
        self.drawing = QSvgRenderer(str(drawing)) if drawing.exists() else QSvgRenderer()
        self.pixmap = QPixmap() if self.drawing.isValid() else QPixmap(path)
        self.setToolTip(plain_tooltip(path))
        self.setAccessibleName(f"Figure {Path(path).stem}")
        self.update()

    def set_theme(self, theme: Theme) -> None:
        """Keep the figure's own colours."""

    def picture(self) -> Picture:
        """Return the figure in its own size."""
        size = self._size().toSize()
        whole = QRectF(0, 0, size.width(), size.height())

        def paint(painter: QPainter) -> None:
            painter.fillRect(whole, Qt.GlobalColor.white)
            self._draw(painter, whole)

        return Picture(size, paint)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the figure in the middle."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        if self.is_shown:
            fit = Qt.AspectRatioMode.KeepAspectRatio
            size = self._size().scaled(QSizeF(self.size()), fit)
            left, top = (self.width() - size.width()) / 2, (self.height() - size.height()) / 2
            self._draw(painter, QRectF(left, top, size.width(), size.height()))

    def _size(self) -> QSizeF:
        drawing = self.drawing
        return QSizeF(drawing.defaultSize() if drawing.isValid() else self.pixmap.size())

    def _draw(self, painter: QPainter, place: QRectF) -> None:
        if self.drawing.isValid():
            self.drawing.render(painter, place)
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawPixmap(place, self.pixmap, QRectF(self.pixmap.rect()))
