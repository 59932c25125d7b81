"""The texts that our own widgets paint, noted while they paint."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

from PySide6.QtCore import QRectF
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QWidget

from tests.gui.texts.piece import CutText, path_of

_SLACK_PX = 1.0


@contextmanager
def painted_texts() -> Iterator[list[CutText]]:
    """Collect the texts that widgets paint outside their places or outside themselves."""
    found: list[CutText] = []
    draw = QPainter.drawText

    def note(painter: QPainter, *args: Any) -> Any:
        device = painter.device()
        if isinstance(device, QWidget):
            found.extend(_judge(painter, device, args))
        return draw(painter, *args)

    with mock.patch.object(QPainter, "drawText", note):
        yield found


def _judge(painter: QPainter, widget: QWidget, args: tuple[Any, ...]) -> Iterator[CutText]:
    place, flags, text = _call(painter, args)
    if not text.strip():
        return
    needs = QRectF(painter.fontMetrics().boundingRect(place.toRect(), flags, text))
    where = path_of(widget)
    if needs.width() > place.width() + _SLACK_PX or needs.height() > place.height() + _SLACK_PX:
        reason = (
            f"needs {needs.width():.0f} × {needs.height():.0f} px and is painted into "
            f"{place.width():.0f} × {place.height():.0f} px"
        )
        yield CutText(where, text, reason)
    shown = painter.worldTransform().mapRect(needs)
    if not QRectF(widget.rect()).adjusted(-1, -1, 1, 1).contains(shown):
        yield CutText(where, text, "is painted beyond the edge of its widget")
    if "…" in text and " …" not in text:
        yield CutText(where, text, "is shortened")


def _call(painter: QPainter, args: tuple[Any, ...]) -> tuple[QRectF, int, str]:
    """Return place, flags and text of a call; a text at a point has its own size as place."""
    *geometry, text = args
    if len(geometry) == 2 and hasattr(geometry[0], "width"):
        return QRectF(geometry[0]), int(geometry[1]), str(text)
    if len(geometry) == 5:
        x, y, width, height, flags = geometry
        return QRectF(x, y, width, height), int(flags), str(text)
    x, y = (geometry[0].x(), geometry[0].y()) if len(geometry) == 1 else geometry
    own = QRectF(painter.fontMetrics().boundingRect(text))
    return own.translated(x, y), 0, str(text)
