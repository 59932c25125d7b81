"""Create plots with fixed ranges and aligned axes, and a line that says what is pointed at."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import ceil, floor, log10
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QAccessible, QAccessibleEvent, QFontMetrics
from PySide6.QtWidgets import (
    QApplication,
    QGraphicsGridLayout,
    QGraphicsItem,
    QGraphicsWidget,
    QSizePolicy,
    QWidget,
)

from gui.widgets.labels import label
from gui.widgets.layouts import vbox
from gui.widgets.theme import Theme, scaled_px, text_scale

LEFT_PX = 74
"""A name of two lines beside numbers of four digits and a point."""
MAX_TICKS = 10
_ROUND_STEPS_S = (
    0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0,
)  # fmt: skip
BOTTOM_PX = 34
_BEYOND_PX, RIGHT_PX = 24, 20
"""How far a number may reach beyond the end of its axis, and the room for it right of a plot."""
_USUAL_PX = "usual_px"
_LONG_TIME = "−10.0 "


SIDES = {"left": (2, 0), "bottom": (3, 1), "right": (2, 2)}
"""Row and column of each axis around the view; the title stands at the top."""
TITLE_PX = 30


class Plot(QGraphicsWidget):
    """A view with axes and a title, with the methods of pyqtgraph's PlotItem that are used here.

    PlotItem makes eight menus and more than thirty other widgets for options of its own, also where
    they cannot be reached: a third of all widgets of a window of ours, which every style sheet
    colours.
    """

    def __init__(self) -> None:
        super().__init__()
        expanding = QSizePolicy.Policy.Expanding
        self.setSizePolicy(expanding, expanding)
        self.grid = QGraphicsGridLayout(self)
        self.grid.setContentsMargins(1, 1, 1, 1)
        self.grid.setSpacing(0)
        self.grid.setRowStretchFactor(2, 100)
        self.grid.setColumnStretchFactor(1, 100)
        self._view = pg.ViewBox(parent=self, enableMenu=False)
        self._axes: dict[str, Any] = {}
        self.grid.addItem(self._view, 2, 1)
        self.items: list[QGraphicsItem] = []
        for side in ("left", "bottom"):
            self.getAxis(side)
        self.titleLabel = pg.LabelItem("", parent=self)
        self.titleLabel.setMaximumHeight(0)
        self.grid.addItem(self.titleLabel, 0, 1)

    def implements(self, interface: str) -> bool:
        """Tell pyqtgraph that an axis can be linked to this plot's view."""
        return interface == "ViewBoxWrapper"

    def getViewBox(self) -> Any:
        """Return the view."""
        return self._view

    def getAxis(self, side: str) -> Any:
        """Return the axis at the left, at the bottom or at the right, made when it is wanted."""
        if side not in self._axes:
            axis = self._axes[side] = pg.AxisItem(orientation=side, parent=self)
            axis.autoSIPrefix = False  # it would write the label anew for each change of the range
            axis.linkToView(self._view)
            axis.setZValue(-1000)  # below what the view shows
            axis.setFlag(QGraphicsItem.GraphicsItemFlag.ItemNegativeZStacksBehindParent)
            self.grid.addItem(axis, *SIDES[side])
        return self._axes[side]

    def setLabel(self, side: str, text: str, **style: str) -> None:
        """Write a label at an axis."""
        self.getAxis(side).setLabel(text, **style)

    def setTitle(self, text: str, **style: str) -> None:
        """Write a title above the view."""
        self.titleLabel.setMaximumHeight(TITLE_PX)
        self.grid.setRowFixedHeight(0, TITLE_PX)
        self.titleLabel.setText(text, **style)

    def addItem(self, item: QGraphicsItem) -> None:
        """Show an item in the view, whose range does not follow it."""
        self.items.append(item)
        self._view.addItem(item, ignoreBounds=True)

    def removeItem(self, item: QGraphicsItem) -> None:
        """Show an item no longer."""
        if item in self.items:
            self.items.remove(item)
            self._view.removeItem(item)

    def clear(self) -> None:
        """Remove all items."""
        for item in list(self.items):
            self.removeItem(item)

    def setXRange(self, low: float, high: float, padding: float | None = None) -> None:
        """Show this part of the horizontal axis."""
        self._view.setXRange(low, high, padding=padding)

    def setYRange(self, low: float, high: float, padding: float | None = None) -> None:
        """Show this part of the vertical axis."""
        self._view.setYRange(low, high, padding=padding)

    def setXLink(self, other: Plot) -> None:
        """Show the same part of the horizontal axis as another plot."""
        self._view.setXLink(other)

    def viewRange(self) -> list[list[float]]:
        """Return the lower and upper end of both axes."""
        return list(self._view.viewRange())

    def setMouseEnabled(self, x: bool, y: bool) -> None:
        """Let the mouse move and scale the axes."""
        self._view.setMouseEnabled(x=x, y=y)

    def invertY(self, is_down: bool = True) -> None:
        """Let the vertical axis count downwards."""
        self._view.invertY(is_down)


class ColourScale(Plot):
    """The colours of an image as a bar, with an axis of the image's levels at its right."""

    def __init__(self, image: pg.ImageItem, colours: pg.ColorMap, width_px: float) -> None:
        super().__init__()
        self._image, self._bar = image, pg.ImageItem(axisOrder="row-major")
        self._bar.setImage(np.arange(256.0)[:, None], levels=(0.0, 255.0))
        for one in (image, self._bar):
            one.setColorMap(colours)
        self.addItem(self._bar)
        for side in ("left", "bottom"):
            self.getAxis(side).hide()
        self.axis = self.getAxis("right")
        self.grid.setColumnFixedWidth(1, width_px)
        self.getViewBox().disableAutoRange()
        self.setMouseEnabled(x=False, y=False)
        self.setXRange(0, 1, padding=0)
        self.show_levels(0.0, 1.0)

    def show_levels(self, low: float, high: float) -> None:
        """Give the first and the last colour to these values, in the image, too."""
        self._image.setLevels((low, high))
        self._bar.setRect(0.0, low, 1.0, high - low)
        self.setYRange(low, high, padding=0)

    def colour(self, theme: Theme, text: str) -> None:
        """Apply a theme, and name the axis."""
        self.axis.setLabel(text)
        colour_axes(self, theme, ("right",))
        self.getViewBox().setBorder(pg.mkPen(theme.line, width=1))


def add_plot(layout: pg.GraphicsLayout, row: int, column: int) -> Plot:
    """Return a new plot in a cell of a layout."""
    plot = Plot()
    layout.addItem(plot, row, column)
    return plot


def fixed_plot(layout: pg.GraphicsLayout, row: int, column: int) -> Plot:
    """Return a plot that the mouse cannot move and that never rescales itself."""
    plot = add_plot(layout, row, column)
    plot.setMouseEnabled(x=False, y=False)
    plot.getViewBox().disableAutoRange()
    for side in ("left", "bottom"):
        # Drawing nine axes in each frame takes longer than all curves; cached pixmaps do not.
        plot.getAxis(side).setStyle(hideOverlappingLabels=_BEYOND_PX)
        plot.getAxis(side).setCacheMode(QGraphicsItem.CacheMode.DeviceCoordinateCache)
    return plot


def reserve(plot: Plot, side: str, usual_px: float) -> None:
    """Give an axis its width or height, which grows with the texts."""
    axis = plot.getAxis(side)
    axis.setProperty(_USUAL_PX, usual_px)
    _fit_axis(axis)


def reserve_right(layout: pg.GraphicsLayout) -> None:
    """Leave room right of the plots for half a number at the end of their axes."""
    left, top, _, bottom = layout.layout.getContentsMargins()
    layout.layout.setContentsMargins(left, top, scaled_px(RIGHT_PX), bottom)


def label_axis(plot: Plot, side: str, text: str, theme: Theme) -> None:
    """Write a label in the middle of an axis, also where it is longer than the one before."""
    plot.setLabel(side, text, color=theme.muted)
    plot.getAxis(side).resizeEvent()  # pyqtgraph places the label only there


def title_plot(plot: Plot, text: str, colour: str, usual_pt: float = 9.0) -> None:
    """Write a title above a plot."""
    plot.setTitle(text or " ", color=colour, size=f"{usual_pt * text_scale():g}pt")


def _fit_axis(axis: pg.AxisItem) -> None:
    font, usual_px = QApplication.font(), axis.property(_USUAL_PX)
    axis.setTickFont(font)
    axis.label.setFont(font)
    if axis.style["hideOverlappingLabels"] not in (True, False):
        axis.setStyle(hideOverlappingLabels=scaled_px(_BEYOND_PX))
    if usual_px is not None:
        upright = axis.orientation in ("left", "right")
        (axis.setWidth if upright else axis.setHeight)(scaled_px(usual_px))
    axis.resizeEvent()


def time_plot(layout: pg.GraphicsLayout, row: int, label: str, last: bool) -> Plot:
    """Return a plot over time, with the same left margin as the others; the last shows times."""
    plot = fixed_plot(layout, row, 0)
    plot.setLabel("left", label)
    reserve(plot, "left", LEFT_PX)
    plot.getAxis("bottom").setStyle(showValues=last)
    if last:
        plot.setLabel("bottom", "Time relative to now (s)")
        reserve(plot, "bottom", BOTTOM_PX)
    else:
        plot.getAxis("bottom").setHeight(6)
    return plot


def colour_axes(plot: Plot, theme: Theme, sides: Sequence[str] = ("left", "bottom")) -> None:
    """Apply a theme and the size of the texts to a plot's axes, labels and background."""
    plot.getViewBox().setBackgroundColor(theme.plot)
    for side in sides:
        axis = plot.getAxis(side)
        axis.setPen(pg.mkPen(theme.line, width=1))
        axis.setTextPen(pg.mkPen(theme.muted))
        axis.setLabel(axis.labelText, units=None, color=theme.muted)
        _fit_axis(axis)


def taxel_ticks(n_taxels: int) -> list[tuple[float, str]]:
    """Return ticks for every second taxel, or for ten: the middle of its band, and its name."""
    step = max(2, -(-n_taxels // MAX_TICKS))
    return [(taxel + 0.5, f"T{taxel + 1}") for taxel in range(0, n_taxels, step)]


def most_ticks(width_px: float) -> int:
    """Return how many steps an axis of times has room for in the present size of the texts."""
    return max(1, min(MAX_TICKS, int(width_px / text_width_px(_LONG_TIME))))


def text_width_px(text: str) -> int:
    """Return the width of a label of an axis."""
    return QFontMetrics(QApplication.font()).horizontalAdvance(text)


def time_ticks(left_s: float, right_s: float, most: int = MAX_TICKS) -> list[tuple[float, str]]:
    """Return ticks at round times between two ends of an axis, in at most ``most`` steps.

    pyqtgraph's own ticks cost more than the plots themselves while an axis scrolls.
    """
    least_s = (right_s - left_s) / most
    step_s = next((step for step in _ROUND_STEPS_S if step >= least_s), _ROUND_STEPS_S[-1])
    digits = max(0, -floor(log10(step_s)))
    numbers = range(ceil(left_s / step_s), floor(right_s / step_s) + 1)
    return [(n * step_s, f"{n * step_s:.{digits}f}".replace("-", "−")) for n in numbers]


def whole_ticks(top: float, most: int = 6) -> list[tuple[float, str]]:
    """Return ticks at whole numbers from 0 to the top of an axis, with ``most`` round steps."""
    step = next(
        factor * 10**power
        for power in range(len(f"{top:.0f}"))
        for factor in (1, 2, 5, 10)
        if top <= most * factor * 10**power
    )
    return [(float(number), f"{number}") for number in range(0, int(top) + 1, step)]


HEADING_PT = 10.0


class PlotGrid(QWidget):
    """Holds a pyqtgraph view: pyqtgraph has no types, so that a subclass of its would have none.

    ``graphics``: the view, which fills the widget below what stands ``above``. ``cells``: the
    layout of its plots.
    """

    def __init__(self, *above: QWidget) -> None:
        super().__init__()
        self.graphics = pg.GraphicsLayoutWidget()
        self.cells = self.graphics.ci
        self.setLayout(vbox(*above, self.graphics, tall=len(above)))
        self.setFocusProxy(self.graphics)

    def reserve_plots(self, width_px: float, *heights_px: float) -> None:
        """Keep room for the texts of the first column, whose rows have these heights."""
        self.cells.layout.setColumnMinimumWidth(0, scaled_px(width_px))
        for row, height_px in enumerate(heights_px):
            self.cells.layout.setRowMinimumHeight(row, scaled_px(height_px))
        self.keep_readable()

    def keep_readable(self) -> None:
        """Let the view become no smaller than its plots, in the present size of the texts."""
        self.cells.layout.invalidate()
        needs = self.cells.layout.effectiveSizeHint(Qt.SizeHint.MinimumSize)
        self.graphics.setMinimumSize(ceil(needs.width()), ceil(needs.height()))

    def show_heading(self, plot: Plot, text: str, theme: Theme) -> None:
        """Write what all plots show above the first one, and keep room for it."""
        title_plot(plot, escape(text), theme.muted, HEADING_PT)
        plot.grid.addItem(plot.titleLabel, 0, 0, 1, 3)  # over the axis, too
        self.keep_readable()

    def colour(self, theme: Theme, *plots: Plot) -> None:
        """Give the space around all plots, and the axes of these, the colours of a theme."""
        self.graphics.setBackground(theme.panel)
        for plot in plots:
            colour_axes(plot, theme)


LINES = 3


class Readout(QWidget):
    """Three lines of text, whose height does not change; they describe the plot ``described``."""

    def __init__(self, described: QWidget, hint: str) -> None:
        super().__init__()
        self._described, self._hint = described, hint
        self.label = label("", wraps=True)
        self.setLayout(vbox(self.label, margins=(8, 2, 8, 2), tall=-1))
        self.show_words("")

    def show_words(self, words: str) -> None:
        """Show a point in words, or how to choose one."""
        text = words or self._hint
        self.setMinimumHeight(LINES * QFontMetrics(self.font()).lineSpacing() + 4)
        if self.label.text() != text:
            self.label.setText(text)
            self._described.setAccessibleDescription(text)
            changed = QAccessible.Event.DescriptionChanged
            QAccessible.updateAccessibility(QAccessibleEvent(self._described, changed))
