"""Mix colours, and turn them into pixels of an image."""

from __future__ import annotations

from PySide6.QtGui import QColor


def rgb(colour: str) -> int:
    """Return a colour as a 32-bit pixel of QImage's RGB32 format."""
    return int(QColor(colour).rgb())


def blend(colour: str, background: str, share: float) -> str:
    """Return ``colour`` over ``background`` with opacity ``share``."""
    over, under = QColor(colour), QColor(background)
    parts = (QColor.red, QColor.green, QColor.blue)
    return QColor(*(round(share * part(over) + (1 - share) * part(under)) for part in parts)).name()
