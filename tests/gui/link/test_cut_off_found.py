"""The measurement of texts finds what a user would see cut, and nothing else."""

from __future__ import annotations

import pyqtgraph as pg
import pytest
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QComboBox,
    QLabel,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QTableWidget,
    QTabWidget,
    QWidget,
)

from gui.widgets.labels import elastic, label
from gui.widgets.layouts import container, scroll_area, vbox
from tests.gui.texts.cut import cut_texts

LONG = "a sentence of quite some words"


class PaintedText(QWidget):
    """A widget that paints a text into a place of its own."""

    def __init__(self, place: QRectF) -> None:
        super().__init__()
        self._place = place

    def paintEvent(self, event: QPaintEvent) -> None:
        """Paint the text."""
        painter = QPainter(self)
        painter.drawText(self._place, Qt.AlignmentFlag.AlignCenter, LONG)


def _combo_box() -> QComboBox:
    box = QComboBox()
    box.addItems(["short", LONG])
    return box


def _tabs() -> QTabWidget:
    tabs = QTabWidget()
    tabs.addTab(QLabel("page"), LONG)
    return tabs


def _table() -> QTableWidget:
    table = QTableWidget(1, 1)
    table.setHorizontalHeaderLabels([LONG])
    return table


def _spin_box() -> QSpinBox:
    return QSpinBox(maximum=2**31 - 1, suffix=" mm/s")


KINDS = [
    lambda: label(LONG),
    lambda: QLabel(LONG, wordWrap=True),
    lambda: QPushButton(LONG),
    lambda: QCheckBox(LONG),
    lambda: QLineEdit(placeholderText=LONG),
    _combo_box,
    _tabs,
    _table,
    _spin_box,
    lambda: PaintedText(QRectF(0, 0, 400, 30)),
]


@pytest.mark.parametrize("make", KINDS)
def test_each_kind_of_widget_is_cut_when_it_is_narrow_and_whole_when_it_is_wide(
    qapp: QApplication, make: type[QWidget]
) -> None:
    parent = QWidget()
    widget = make()
    widget.setParent(parent)
    parent.resize(500, 200)
    widget.setGeometry(0, 0, 450, 120)
    if isinstance(widget, QTableWidget):
        widget.setColumnWidth(0, 300)
    parent.show()
    QApplication.processEvents()
    assert cut_texts(parent) == []
    widget.setGeometry(0, 0, 60, 20)
    if isinstance(widget, QTableWidget):
        widget.setColumnWidth(0, 40)
    QApplication.processEvents()
    assert [cut.text for cut in cut_texts(parent)]


def test_a_text_below_a_scroll_bar_is_whole_and_one_beside_it_is_not(qapp: QApplication) -> None:
    below = QWidget()
    below.setLayout(vbox(*(label(f"{LONG} {n}") for n in range(40))))
    area = scroll_area(below)
    area.resize(400, 200)
    area.show()
    QApplication.processEvents()
    assert cut_texts(area) == []
    area.resize(80, 200)
    QApplication.processEvents()
    assert len(cut_texts(area)) == 40


def test_an_elastic_label_is_cut(qapp: QApplication) -> None:
    window = container(vbox(elastic(label(LONG))))
    window.resize(50, 30)
    window.show()
    QApplication.processEvents()
    assert [cut.text for cut in cut_texts(window)] == [LONG]


def test_labels_and_ticks_of_plots_are_measured(qapp: QApplication) -> None:
    plot = pg.PlotWidget()
    plot.setLabel("left", LONG)
    plot.resize(600, 500)
    plot.show()
    QApplication.processEvents()
    plot.getAxis("left").setTicks([[(0.5, "half")]])
    assert cut_texts(plot) == []
    plot.getAxis("bottom").setTicks([[(0.50, "one tick"), (0.51, "its neighbour")]])
    plot.getAxis("bottom").setStyle(hideOverlappingLabels=False)
    plot.resize(600, 100)
    QApplication.processEvents()
    reasons = {cut.text: cut.reason for cut in cut_texts(plot)}
    assert "overlaps" in reasons["its neighbour"] and LONG in reasons


def test_a_wrapped_text_gives_room_back_when_it_is_wider_or_shorter(qapp: QApplication) -> None:
    wrapped = label("off, it may rest on the sensor", wraps=True)
    wrapped.resize(40, 20)
    wrapped.show()
    qapp.processEvents()
    tall_px = wrapped.minimumHeight()
    wrapped.resize(400, tall_px)
    qapp.processEvents()
    assert wrapped.minimumHeight() < tall_px
    wrapped.close()
