"""Write what a widget shows as PNG, SVG or PDF."""

from __future__ import annotations

from itertools import count
from pathlib import Path

from PySide6.QtCore import QMarginsF, QPoint, QRect, QSize, QSizeF
from PySide6.QtGui import QPageLayout, QPageSize, QPainter, QPdfWriter
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsView, QWidget

from rigctl.errors import DiskFault

PICTURES = ("png", "svg", "pdf")
DOTS_PER_INCH, DOTS_PER_POINT = 96, 96 / 72


def new_file(folder: Path, stem: str, suffix: str) -> Path:
    """Return the path of a new file in a folder, which is made; no file is ever overwritten.

    Raises DiskFault.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DiskFault(f"{folder} cannot be made ({error}): choose another place") from error
    names = (f"{stem}{f'-{n}' if n > 1 else ''}.{suffix}" for n in count(1))
    return next(folder / name for name in names if not (folder / name).exists())


def save_picture(widget: QWidget, path: Path) -> None:
    """Write a widget's picture in the format of the file's name. Raises DiskFault."""
    if path.suffix == ".png":
        is_saved = widget.grab().save(str(path))
    elif path.suffix == ".svg":
        is_saved = _paint(widget, _svg(path, widget.size()))
    else:
        is_saved = _paint(widget, _pdf(path, widget.size()))
    if not is_saved or not path.exists():
        raise DiskFault(f"{path} cannot be written: free some space, or open another session")


def _svg(path: Path, size: QSize) -> QSvgGenerator:
    device = QSvgGenerator()
    device.setFileName(str(path))
    device.setSize(size)
    device.setViewBox(QRect(QPoint(0, 0), size))
    device.setTitle(path.stem)
    return device


def _pdf(path: Path, size: QSize) -> QPdfWriter:
    device = QPdfWriter(str(path))
    device.setResolution(DOTS_PER_INCH)
    points = QSizeF(size.width() / DOTS_PER_POINT, size.height() / DOTS_PER_POINT)
    page = QPageSize(points, QPageSize.Unit.Point, "", QPageSize.SizeMatchPolicy.ExactMatch)
    layout = QPageLayout(page, QPageLayout.Orientation.Portrait, QMarginsF(0, 0, 0, 0))
    device.setPageLayout(layout)
    return device


def _paint(widget: QWidget, device: QSvgGenerator | QPdfWriter) -> bool:
    painter = QPainter()
    if not painter.begin(device):
        return False
    if isinstance(widget, QGraphicsView):
        widget.render(painter, painter.viewport(), widget.viewport().rect())
    else:
        widget.render(painter, QPoint(0, 0))
    return painter.end()
