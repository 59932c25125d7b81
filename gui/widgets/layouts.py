"""Layouts and small controls that several panels share."""

from __future__ import annotations

from typing import TypeVar

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLayout,
    QPushButton,
    QScrollArea,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

_Layout = TypeVar("_Layout", bound=QLayout)


def group_box(title: str, layout: _Layout) -> tuple[QGroupBox, _Layout]:
    """Return a titled box and the layout inside it."""
    box = QGroupBox(title)
    layout.setContentsMargins(8, 6, 8, 8)
    box.setLayout(layout)
    return box, layout


def vbox(*widgets: QWidget, spacing: int = 0) -> QVBoxLayout:
    """Return a vertical layout without margins."""
    layout = QVBoxLayout()
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setSpacing(spacing)
    for widget in widgets:
        layout.addWidget(widget)
    return layout


def hbox(wide: QWidget, *narrow: QWidget) -> QHBoxLayout:
    """Return a horizontal layout without margins; the first widget takes the spare width."""
    layout = QHBoxLayout()
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setSpacing(4)
    layout.addWidget(wide, 1)
    for widget in narrow:
        layout.addWidget(widget)
    return layout


def form_layout(spacing: int) -> QFormLayout:
    """Return a form whose fields take the spare width."""
    layout = QFormLayout()
    layout.setContentsMargins(0, 0, 0, 0)
    layout.setVerticalSpacing(spacing)
    layout.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    return layout


def container(layout: QLayout) -> QWidget:
    """Return a widget that holds a layout."""
    widget = QWidget()
    widget.setLayout(layout)
    return widget


def scroll_area(widget: QWidget) -> QScrollArea:
    """Return an area that scrolls its widget vertically where the screen is too low for it."""
    area = QScrollArea()
    area.setWidget(widget)
    area.setWidgetResizable(True)
    area.setFrameShape(QScrollArea.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    return area


def combo_box(items: dict[str, str]) -> QComboBox:
    """Return a list of texts with their data; it may be narrower than its longest text."""
    box = QComboBox()
    for text, data in items.items():
        box.addItem(text, data)
    box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    box.setMinimumContentsLength(8)
    return box


def spin_box(low: int, high: int, value: int) -> QSpinBox:
    """Return a field for an integer."""
    box = QSpinBox()
    box.setRange(low, high)
    box.setValue(value)
    return box


def small_button(text: str, tooltip: str) -> QPushButton:
    """Return a button that is as wide as one character."""
    button = QPushButton(text)
    button.setFixedWidth(34)
    button.setToolTip(tooltip)
    return button
