"""A line below a saved picture that says whether its data are simulated."""

from __future__ import annotations

from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QImage, QPainter

from gui.analysis.export.value_file import data_words

FOOT_PX = 20
_MARGIN_PX = 8
_ALIGNMENT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter


def foot_text(*about: str, simulated: bool) -> str:
    """Return the line: that the data are simulated, if they are, and what they are."""
    return " · ".join(filter(None, (data_words(simulated=True) if simulated else "", *about)))


def paint_foot(painter: QPainter, size: QSize, text: str) -> None:
    """Paint the line below a picture of this size, :data:`FOOT_PX` high."""
    line = QRect(0, size.height(), size.width(), FOOT_PX)
    painter.save()
    painter.fillRect(line, Qt.GlobalColor.white)
    painter.setPen(Qt.GlobalColor.black)
    painter.drawText(line.adjusted(_MARGIN_PX, 0, -_MARGIN_PX, 0), _ALIGNMENT, text)
    painter.restore()


def image_with_foot(image: QImage, text: str) -> QImage:
    """Return an image with the line below it."""
    ratio = image.devicePixelRatio()
    taller = QImage(image.width(), image.height() + round(FOOT_PX * ratio), image.format())
    taller.setDevicePixelRatio(ratio)
    painter = QPainter(taller)
    painter.drawImage(0, 0, image)
    paint_foot(painter, image.deviceIndependentSize().toSize(), text)
    painter.end()
    return taller
