"""Paint a picture and encode it as PNG, SVG or PDF."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from PySide6.QtCore import (
    QBuffer,
    QByteArray,
    QIODevice,
    QMarginsF,
    QPoint,
    QRect,
    QSize,
    QSizeF,
)
from PySide6.QtGui import QImage, QImageWriter, QPageLayout, QPageSize, QPainter, QPdfWriter
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsView, QWidget

from gui.analysis.export.picture_foot import FOOT_PX, paint_foot
from rigctl.errors import WrongUse

PICTURES = ("png", "svg", "pdf")
DOTS_PER_INCH, DOTS_PER_POINT = 96, 96 / 72
PNG_RATIO = 2
"""Pixels of a PNG for one of the screen, so that it is sharp in print."""


class Picture(NamedTuple):
    """A picture of some size that paints itself anywhere."""

    size: QSize
    paint: Callable[[QPainter], None]


class PaintedPicture(NamedTuple):
    """A picture that is painted and not yet encoded.

    ``image``: of a PNG. ``painter``: holds the ``device`` of the other formats open, which writes
    into ``buffer``.
    """

    buffer: QBuffer
    image: QImage | None = None
    device: QSvgGenerator | QPdfWriter | None = None
    painter: QPainter | None = None

    def encode(self) -> bytes:
        """Return the bytes of the file; any thread may do that. Raises WrongUse without memory."""
        if self.image is not None:
            writer = QImageWriter(self.buffer, QByteArray(b"png"))
            if not writer.write(self.image):
                reason = writer.errorString()
                raise WrongUse(f"the picture cannot be encoded ({reason}): make the window smaller")
        elif self.painter is not None:
            self.painter.end()
        self.buffer.close()
        return bytes(self.buffer.data().data())


def widget_picture(widget: QWidget) -> Picture:
    """Return what a widget shows."""

    def paint(painter: QPainter) -> None:
        if isinstance(widget, QGraphicsView):
            target = QRect(QPoint(0, 0), widget.size())
            widget.render(painter, target, widget.viewport().rect())
        else:
            widget.render(painter, QPoint(0, 0))

    return Picture(widget.size(), paint)


def with_foot(picture: Picture, text: str) -> Picture:
    """Return a picture with a line of text below it."""

    def paint(painter: QPainter) -> None:
        paint_foot(painter, picture.size, text)
        picture.paint(painter)

    return Picture(picture.size + QSize(0, FOOT_PX), paint)


def paint_picture(picture: Picture, suffix: str, title: str) -> PaintedPicture:
    """Paint a picture for a format of :data:`PICTURES`; only the Qt thread may do that."""
    buffer = QBuffer()
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    if suffix == "png":
        return PaintedPicture(buffer, painted_image(picture, PNG_RATIO))
    begin = _svg if suffix == "svg" else _pdf
    device = begin(buffer, picture.size, title)
    painter = QPainter(device)
    picture.paint(painter)
    return PaintedPicture(buffer, None, device, painter)


def painted_image(picture: Picture, ratio: float) -> QImage:
    """Return a picture as an image with ``ratio`` pixels for one of the screen."""
    image = QImage(picture.size * ratio, QImage.Format.Format_RGB32)
    image.setDevicePixelRatio(ratio)
    painter = QPainter(image)
    picture.paint(painter)
    painter.end()
    return image


def _svg(buffer: QBuffer, size: QSize, title: str) -> QSvgGenerator:
    device = QSvgGenerator()
    device.setOutputDevice(buffer)
    device.setSize(size)
    device.setViewBox(QRect(QPoint(0, 0), size))
    device.setTitle(title)
    return device


def _pdf(buffer: QBuffer, size: QSize, title: str) -> QPdfWriter:
    device = QPdfWriter(buffer)
    device.setResolution(DOTS_PER_INCH)
    device.setTitle(title)
    points = QSizeF(size.width() / DOTS_PER_POINT, size.height() / DOTS_PER_POINT)
    page = QPageSize(points, QPageSize.Unit.Point, "", QPageSize.SizeMatchPolicy.ExactMatch)
    layout = QPageLayout(page, QPageLayout.Orientation.Portrait, QMarginsF(0, 0, 0, 0))
    device.setPageLayout(layout)
    return device
