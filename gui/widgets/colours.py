"""Mix and compare colours, and turn them into pixels of an image."""

from __future__ import annotations

from PySide6.QtGui import QColor

_PARTS = (QColor.redF, QColor.greenF, QColor.blueF)


def rgb(colour: str) -> int:
    """Return a colour as a 32-bit pixel of QImage's RGB32 format."""
    return int(QColor(colour).rgb())


def blend(colour: str, background: str, share: float) -> str:
    """Return ``colour`` over ``background`` with opacity ``share``."""
    over, under = QColor(colour), QColor(background)
    parts = (QColor.red, QColor.green, QColor.blue)
    return QColor(*(round(share * part(over) + (1 - share) * part(under)) for part in parts)).name()


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours by WCAG 2.2, 1 to 21."""
    low, high = sorted(map(_luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    red, green, blue = (_linear(part(QColor(colour))) for part in _PARTS)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _linear(part: float) -> float:
    return part / 12.92 if part <= 0.04045 else float(((part + 0.055) / 1.055) ** 2.4)
