"""Pictures and tables of what a page shows, painted, encoded and saved as files."""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import count
from typing import NamedTuple

from PySide6.QtCore import (
    QBuffer,
    QByteArray,
    QIODevice,
    QMarginsF,
    QObject,
    QPoint,
    QRect,
    QSize,
    QSizeF,
    Qt,
    Signal,
)
from PySide6.QtGui import QImage, QImageWriter, QPageLayout, QPageSize, QPainter, QPdfWriter
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsView, QMenu, QToolButton, QWidget

from gui.analysis.value_file import data_words
from gui.widgets.theme import scaled_px
from rigctl.errors import RigctlError, WrongUse

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


_CLOSE_TIMEOUT_S = 30.0


class NewFile(NamedTuple):
    """Where a file goes: its folder, the beginning of its name, and its suffix."""

    folder: str
    stem: str
    suffix: str


class PictureEncoder(QObject):
    """Each picture has a thread: compressing a large one takes a tenth of a second and more."""

    encoded = Signal(object, object)
    """The :class:`NewFile`, and its content in bytes."""
    failed = Signal(str)
    """Why a picture was not encoded, and the cure."""
    _ended = Signal(int, object, str)

    def __init__(self) -> None:
        super().__init__()
        self._numbers = count()
        self._jobs: dict[int, tuple[NewFile, PaintedPicture]] = {}
        self._threads: list[threading.Thread] = []
        self._ended.connect(self._finish)

    def encode(self, picture: Picture, file: NewFile) -> None:
        """Paint a picture now; :attr:`encoded` or :attr:`failed` follows."""
        number, painted = next(self._numbers), paint_picture(picture, file.suffix, file.stem)
        self._jobs[number] = file, painted  # Qt's objects end in the thread that made them
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(
            target=self._encode, args=(number, painted), name="rigctl-picture-encoder"
        )
        self._threads.append(thread)
        thread.start()

    def wait(self) -> None:
        """Wait until every picture is encoded, as before the window closes."""
        for thread in self._threads:
            thread.join(_CLOSE_TIMEOUT_S)

    def _encode(self, number: int, painted: PaintedPicture) -> None:
        content, problem = b"", ""
        try:
            content = painted.encode()
        except RigctlError as error:
            problem = str(error)
        self._ended.emit(number, content, problem)

    def _finish(self, number: int, content: bytes, problem: str) -> None:
        file, _ = self._jobs.pop(number)
        if problem:
            self.failed.emit(problem)
        else:
            self.encoded.emit(file, content)


TABLE = "csv"
FORMATS = (*PICTURES, TABLE)
_ARROW_PX = 14


class ExportButton(QToolButton):
    """A menu of file formats."""

    export_requested = Signal(str)
    """The suffix of the file: png, svg, pdf or csv."""

    def __init__(self, *formats: str) -> None:
        super().__init__()
        self.setText("Save")
        self.setToolTip("Save what this page shows as a file beside the session")
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.formats = QMenu(self)
        self.suffixes = formats or FORMATS
        for suffix in self.suffixes:
            action = self.formats.addAction(suffix.upper())
            action.triggered.connect(lambda _=False, s=suffix: self.export_requested.emit(s))
        self.setMenu(self.formats)

    def sizeHint(self) -> QSize:
        """Return the size with room for the arrow beside the text."""
        return super().sizeHint() + QSize(scaled_px(_ARROW_PX), 0)
