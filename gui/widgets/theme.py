"""The light and the dark theme, their application to Qt, and colours."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication, QWidget

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


class ThemeChoice(StrEnum):
    """The choices of the View menu."""

    SYSTEM = "Follow system"
    LIGHT = "Light"
    DARK = "Dark"


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours by their meaning.

    The four row groups differ in hue between SA (cool) and RA (warm) and in lightness between
    the layers, so that they stay apart for the colour-blind (after Okabe and Ito, 2008).
    """

    name: str
    window: str
    panel: str
    text: str
    muted: str
    line: str
    accent: str
    ok: str
    warn: str
    bad: str
    bad_back: str
    right_back: str
    wrong_back: str
    unsure_back: str
    plot: str
    gap: str
    set_point: str
    force: str
    speed: str
    layers: tuple[str, str]
    groups: tuple[str, str, str, str]


_COLOURS: dict[str, tuple[Any, Any]] = {
    "window": ("#f3f4f6", "#171a1f"),
    "panel": ("#ffffff", "#1f242a"),
    "text": ("#1b1f24", "#e6e9ed"),
    "muted": ("#59636e", "#9aa4af"),
    "line": ("#ccd2d9", "#39414a"),
    "accent": ("#0b62a8", "#5fb0ee"),
    "ok": ("#1a7f37", "#52c772"),
    "warn": ("#8f5f00", "#e3b341"),
    "bad": ("#b42318", "#ff8178"),
    "bad_back": ("#fde7e4", "#4a1f1c"),
    "right_back": ("#a6dfb5", "#1d5a30"),
    "wrong_back": ("#f5b3ab", "#7d231c"),
    "unsure_back": ("#f3dda0", "#5d4909"),
    "plot": ("#ffffff", "#111418"),
    "gap": ("#f6d5d1", "#4a211e"),
    "set_point": ("#828b96", "#7a848f"),
    "force": ("#0b62a8", "#6fb8f2"),
    "speed": ("#1a7f37", "#67cf85"),
    "layers": (("#1c5a94", "#00765f"), ("#86b9ea", "#4fcfae")),
    "groups": (
        ("#00629e", "#c24e00", "#3c9bd1", "#c08400"),
        ("#4aa5e6", "#ff8b45", "#9ad5ff", "#ffcb5c"),
    ),
}
"""The colours of the light theme and of the dark one."""

STOP_BACKS = ("#c81e1e", "#e02424", "#7d0f0f")
"""Colours of STOP as it is, under the pointer and pressed, in both themes."""

LIGHT = Theme("light", **{key: light for key, (light, _) in _COLOURS.items()})
DARK = Theme("dark", **{key: dark for key, (_, dark) in _COLOURS.items()})
_APPLIED = "rigctl_theme"
_SCALE, _USUAL_PT = "rigctl_text_scale", "rigctl_usual_pt"


def apply_palette(choice: ThemeChoice) -> Theme:
    """Set the palette; return the theme, which follows the system for SYSTEM.

    :func:`apply_theme` follows once the widgets are made: Qt polishes those that have a style sheet
    at each change of their parent, which was half of the time until the window is there.
    """
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    system_is_dark = app.styleHints().colorScheme() is Qt.ColorScheme.Dark
    is_dark = system_is_dark if choice is ThemeChoice.SYSTEM else choice is ThemeChoice.DARK
    theme = DARK if is_dark else LIGHT
    if app.property(_APPLIED) != theme.name:
        app.setProperty(_APPLIED, theme.name)
        if app.style().name() != "fusion":
            app.setStyle("Fusion")
        app.setPalette(_palette(theme))
    return theme


def apply_theme(choice: ThemeChoice, window: QWidget) -> Theme:
    """Set the colours of all widgets of a window; return the theme as :func:`apply_palette`.

    The sheet is the window's: a change of the application's takes Qt six times as long.
    """
    theme = apply_palette(choice)
    sheet = _scaled(_style_sheet(theme), text_scale())
    if window.styleSheet() != sheet:  # polishing every widget again takes a quarter of a second
        window.setStyleSheet(sheet)
    return theme


def scale_texts(factor: float) -> None:
    """Let the next :func:`apply_theme` show all texts ``factor`` times their usual size."""
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    usual_pt = app.property(_USUAL_PT) or app.font().pointSizeF()
    app.setProperty(_USUAL_PT, usual_pt)
    if factor != (app.property(_SCALE) or 1.0):
        font = app.font()
        font.setPointSizeF(usual_pt * factor)
        app.setProperty(_SCALE, factor)  # before widgets hear of the font
        app.setFont(font)


def text_scale() -> float:
    """Return how many times their usual size all texts have."""
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    return float(app.property(_SCALE) or 1.0)


def scaled_px(usual_px: float) -> int:
    """Return the length that texts of the present size need, from that of their usual size."""
    return round(usual_px * text_scale())


def _scaled(style_sheet: str, factor: float) -> str:
    """Return a style sheet whose sizes in points are ``factor`` times as large."""
    return re.sub(
        r"font-size: ([\d.]+)pt",
        lambda size: f"font-size: {float(size[1]) * factor:g}pt",
        style_sheet,
    )


def applied_theme() -> Theme:
    """Return the theme of the running application."""
    app = QApplication.instance()
    return DARK if app is not None and app.property(_APPLIED) == DARK.name else LIGHT


def _palette(theme: Theme) -> QPalette:
    role = QPalette.ColorRole
    palette = QPalette(QColor(theme.panel), QColor(theme.window))
    pairs = {
        role.WindowText: theme.text,
        role.Text: theme.text,
        role.ButtonText: theme.text,
        role.Base: theme.panel,
        role.AlternateBase: theme.window,
        role.ToolTipBase: theme.panel,
        role.ToolTipText: theme.text,
        role.Highlight: theme.accent,
        role.HighlightedText: theme.plot,
        role.PlaceholderText: theme.muted,
        role.Link: theme.accent,
    }
    for colour_role, colour in pairs.items():
        palette.setColor(colour_role, QColor(colour))
    faded = QColor(theme.muted)
    faded.setAlpha(150)
    for colour_role in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, colour_role, faded)
    return palette


def _style_sheet(theme: Theme) -> str:
    usual, hovered, pressed = STOP_BACKS
    return f"""
    QLabel[role="muted"] {{ color: {theme.muted}; }}
    QLabel[role="heading"] {{ font-weight: 600; }}
    QLabel[role="bad"] {{ color: {theme.bad}; font-weight: 600; }}
    QLabel[role="warn"] {{ color: {theme.warn}; font-weight: 600; }}
    QLabel[role="refusal"] {{
        background: {theme.bad_back}; color: {theme.bad}; border: 1px solid {theme.bad};
        border-radius: 4px; padding: 3px 6px;
    }}
    QLabel[role="value"] {{ font-size: 10pt; font-weight: 600; }}
    QLabel[role="stale"] {{ color: {theme.muted}; font-style: italic; }}
    QLabel[role="alarm"] {{ color: {theme.bad}; font-size: 12pt; font-weight: 800; }}
    QLabel[role="value"][level="bad"] {{ color: {theme.bad}; }}
    QLabel[role="value"][level="warn"] {{ color: {theme.warn}; }}
    QLabel[role="value"][level="off"] {{ color: {theme.muted}; }}
    QLabel[role="state"] {{ font-size: 13pt; font-weight: 700; }}
    QLabel[role="state"][level="bad"] {{ color: {theme.bad}; }}
    QLabel[role="state"][level="stale"] {{ color: {theme.muted}; font-style: italic; }}
    QFrame[role="heading"][alarm="on"] {{
        background: {theme.bad_back};
    }}
    QFrame[role="card"] {{
        background: {theme.panel}; border: 1px solid {theme.line}; border-radius: 5px;
    }}
    QFrame[role="card"][level="bad"] {{
        background: {theme.bad_back}; border-color: {theme.bad};
    }}
    QFrame[role="card"][level="warn"] {{ border-color: {theme.warn}; }}
    QFrame[role="answer"] {{
        background: {theme.panel}; border: 2px solid {theme.line}; border-radius: 6px;
    }}
    QFrame[role="answer"][verdict="right"] {{
        background: {theme.right_back}; border-color: {theme.ok};
    }}
    QFrame[role="answer"][verdict="wrong"] {{
        background: {theme.wrong_back}; border-color: {theme.bad};
    }}
    QFrame[role="answer"][verdict="unknown"] {{
        background: {theme.unsure_back}; border-color: {theme.warn};
    }}
    QFrame[role="answer"] QLabel {{ border: none; background: transparent; color: {theme.text}; }}
    QLabel[role="letter"] {{ font-size: 50pt; font-weight: 800; }}
    QLabel[role="mark"] {{ font-size: 34pt; font-weight: 700; }}
    QLabel[role="verdict"] {{ font-size: 13pt; font-weight: 600; }}
    QLabel[role="task"] {{ font-size: 15pt; font-weight: 700; }}
    QFrame[role="prompt"] {{
        background: {theme.panel}; border: 2px solid {theme.accent}; border-radius: 5px;
    }}
    QFrame[role="alarm"] {{
        background: {theme.bad_back}; border: 2px solid {theme.bad}; border-radius: 5px;
    }}
    QFrame[role="alarm"] QLabel {{ border: none; background: transparent; }}
    QGroupBox {{
        border: 1px solid {theme.line}; border-radius: 5px; margin-top: 9px; padding-top: 5px;
        background: {theme.panel};
    }}
    QGroupBox::title {{
        subcontrol-origin: margin; left: 8px; padding: 0 3px; color: {theme.muted};
    }}
    QPushButton:checked {{ color: {theme.accent}; text-decoration: underline; }}
    QPlainTextEdit, QTableView, QListWidget, QTextBrowser {{
        border: 1px solid {theme.line}; border-radius: 4px;
    }}
    QGraphicsView {{ border: 1px solid {theme.window}; }}
    QPlainTextEdit:focus, QTableView:focus, QListWidget:focus, QTextBrowser:focus,
    QGraphicsView:focus {{ border-color: {theme.accent}; }}
    QPushButton#stop {{
        background: {usual}; color: white; border: 2px solid {pressed}; border-radius: 6px;
        font-size: 16pt; font-weight: 800; padding: 2px 26px;
    }}
    QPushButton#stop:hover {{ background: {hovered}; }}
    QPushButton#stop:pressed {{ background: {pressed}; }}
    """
