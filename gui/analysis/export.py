"""Pictures and tables of what a page shows, painted, encoded and saved as files."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from pathlib import Path
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

from gui.analysis.value_file import data_words, new_path
from gui.widgets.background import Background
from gui.widgets.theme import scaled_px
from gui.widgets.typed_paths import new_files_folder
from rigctl.analysis.files import atomic_file
from rigctl.errors import DiskFault, WrongUse

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
            return encoded_png(self.image)
        if self.painter is not None:
            self.painter.end()
        self.buffer.close()
        return bytes(self.buffer.data().data())


def encoded_png(image: QImage) -> bytes:
    """Return the bytes of a PNG. Raises WrongUse without memory."""
    buffer = QBuffer()
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    writer = QImageWriter(buffer, QByteArray(b"png"))
    if not writer.write(image):
        reason = writer.errorString()
        raise WrongUse(f"the picture cannot be encoded ({reason}): make the window smaller")
    return bytes(buffer.data().data())


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


Content = Picture | QImage | bytes | Callable[[Path], object]
"""What a file holds: a picture, an image for a PNG, a text, or what writes it into a path."""


def _write_of(content: Content, suffix: str, title: str) -> Callable[[Path], object]:
    """Return what writes a content into a file, in any thread; only Qt's may call this."""
    if isinstance(content, bytes):
        return lambda path: path.write_bytes(content)
    if isinstance(content, QImage):
        return lambda path: path.write_bytes(encoded_png(content))
    if isinstance(content, Picture):
        painted = paint_picture(content, suffix, title)
        return lambda path: path.write_bytes(painted.encode())
    return content


def in_process(write: Callable[..., object], *content: object) -> Callable[[Path], None]:
    """Return what lets a process write a large table, so that the window keeps its time."""

    def run(path: Path) -> None:
        from concurrent.futures import ProcessPoolExecutor
        from concurrent.futures.process import BrokenProcessPool

        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            try:
                pool.submit(write, *content, path).result()
            except BrokenProcessPool as error:
                raise DiskFault("the process that writes the table ended unexpectedly") from error

    return run


class FileSaver(QObject):
    """Saves new files beside the Qt thread, which only paints their pictures.

    Compressing a large picture takes a tenth of a second and more, a slow disk any time. No file
    is replaced, and none is left that is not whole.
    """

    saved = Signal(str)
    """The path of a file that is complete."""
    failed = Signal(str)
    """Why a file was not saved, and the cure."""

    def __init__(self) -> None:
        super().__init__()
        self._background = Background("rigctl-files")

    def save(self, folder: str, stem: str, suffix: str, content: Content) -> None:
        """Paint a picture now, and save the content; a signal follows."""
        write = _write_of(content, suffix, stem)

        def save() -> str:
            path = new_path(new_files_folder(folder), stem, suffix)
            with atomic_file(path) as whole:
                write(whole)
            return str(path)

        def fail(sentence: str) -> None:
            self.failed.emit(f"nothing was saved: {sentence}")

        self._background.run(save, self.saved.emit, fail)

    def close(self) -> None:
        """Wait until every file is complete, as before the window closes."""
        self._background.close()


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
