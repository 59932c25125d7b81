"""Layouts and small controls that several panels share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLayout,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

_Layout = TypeVar("_Layout", bound=QLayout)
_Box = TypeVar("_Box", bound=QBoxLayout)
_Margins = tuple[int, int, int, int]
_NONE = (0, 0, 0, 0)


def group_box(title: str, layout: _Layout) -> tuple[QGroupBox, _Layout]:
    """Return a titled box and the layout inside it."""
    box = QGroupBox(title)
    layout.setContentsMargins(8, 6, 8, 8)
    box.setLayout(layout)
    return box, layout


def vbox(*items: QWidget | QLayout, spacing: int = 0, margins: _Margins = _NONE) -> QVBoxLayout:
    """Return a vertical layout; ``margins`` are left, top, right and bottom."""
    return _fill(QVBoxLayout(), items, spacing, margins)


def hbox(
    *items: QWidget | QLayout, wide: int = 0, spacing: int = 4, margins: _Margins = _NONE
) -> QHBoxLayout:
    """Return a horizontal layout; the item with the index ``wide`` takes the spare width."""
    layout = _fill(QHBoxLayout(), items, spacing, margins)
    layout.setStretch(wide, 1)
    return layout


def _fill(
    layout: _Box, items: tuple[QWidget | QLayout, ...], spacing: int, margins: _Margins
) -> _Box:
    layout.setContentsMargins(*margins)
    layout.setSpacing(spacing)
    for item in items:
        if isinstance(item, QWidget):
            layout.addWidget(item)
        else:
            layout.addLayout(item)
    return layout


def form_layout(spacing: int) -> QFormLayout:
    """Return a form whose fields take the spare width."""
    growth = QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow
    layout = QFormLayout(verticalSpacing=spacing, fieldGrowthPolicy=growth)
    layout.setContentsMargins(*_NONE)
    return layout


def container(layout: QLayout) -> QWidget:
    """Return a widget that holds a layout."""
    widget = QWidget()
    widget.setLayout(layout)
    return widget


def scroll_area(widget: QWidget) -> QScrollArea:
    """Return an area that scrolls its widget vertically if the screen is too small for it."""
    area = QScrollArea(widgetResizable=True)
    area.setWidget(widget)
    area.setFrameShape(QScrollArea.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    return area


def combo_box(items: dict[str, str]) -> QComboBox:
    """Return a box of texts, each with its data; it may be narrower than its longest text."""
    policy = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
    box = QComboBox(sizeAdjustPolicy=policy, minimumContentsLength=8)
    for text, data in items.items():
        box.addItem(text, data)
    return box


def push_button(text: str, clicked: Callable[[], object], tooltip: str = "") -> QPushButton:
    """Return a button that calls ``clicked``; one character makes it small."""
    button = QPushButton(text)
    button.setToolTip(tooltip)
    button.clicked.connect(lambda: clicked())
    if len(text) == 1:
        button.setFixedWidth(34)
    return button
