"""A finished figure, as large as the place allows."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPixmap
from PySide6.QtWidgets import QWidget


class FigureView(QWidget):
    """Shows a PNG, whole and undistorted, on the paper it was drawn for."""

    def __init__(self) -> None:
        super().__init__()
        self.picture = QPixmap()

    def show_file(self, path: str) -> None:
        """Show another figure."""
        self.picture = QPixmap(path)
        self.setToolTip(path)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Scale it anew, so that it is sharp in every size."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        if self.picture.isNull():
            return
        ratio = self.devicePixelRatioF()
        shown = self.picture.scaled(
            self.size() * ratio,
            Qt.AspectRatioMode.KeepAspectRatio,
            Qt.TransformationMode.SmoothTransformation,
        )
        shown.setDevicePixelRatio(ratio)
        size = shown.deviceIndependentSize()
        left, top = (self.width() - size.width()) / 2, (self.height() - size.height()) / 2
        painter.drawPixmap(round(left), round(top), shown)
