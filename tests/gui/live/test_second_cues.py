"""What a colour means is also said by a shape: readings beyond a range, a set-point."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QImage, QPainter
from PySide6.QtWidgets import QApplication

from gui.live.raster import HeatMap
from gui.live.time_plots import PlotLine, corners
from gui.widgets.theme import DARK, LIGHT, Theme
from rigctl.session.sensor_layout import SensorLayout

LOW, HIGH = np.full(9, 200.0), np.full(9, 800.0)


def grey_rows(heat_map: HeatMap) -> list[float]:
    """Return how bright each row of pixels of the painted map is, without colours."""
    image = QImage(90, 120, QImage.Format.Format_Grayscale8)
    image.fill(Qt.GlobalColor.white)
    painter = QPainter(image)
    heat_map.paint(painter)
    painter.end()
    return [sum(image.pixelColor(x, y).red() for x in range(90)) for y in range(120)]


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
def test_a_reading_beyond_the_range_has_a_mark(qapp: QApplication, theme: Theme) -> None:
    heat_map = HeatMap(theme, SensorLayout.default(9))
    heat_map.setGeometry(QRectF(0, 0, 90, 120))
    painted = []
    for reading, off, side in ((800, 0, 0), (800, -1, 1), (200, 0, 0), (200, 1, -1)):
        heat_map.refresh(np.full((32, 9), reading, np.uint16), LOW + off, HIGH + off)
        assert set(heat_map.beyond) == {side}
        painted.append(grey_rows(heat_map))  # numbers and places in the range stay
    assert painted[0] != painted[1] and painted[2] != painted[3]


def test_dashes_of_a_set_point_are_few_lines() -> None:
    time_s = np.arange(10.0)
    x, y = corners(time_s, np.repeat([80.0, 120.0], 5))
    assert (x.tolist(), y.tolist()) == ([0, 4, 5, 9], [80, 80, 120, 120])
    assert corners(time_s[:0], time_s[:0])[0].size == 0
    line = PlotLine()
    line.set_pen(LIGHT.set_point, is_dashed=True)
    assert line.pen.style() is Qt.PenStyle.CustomDashLine
