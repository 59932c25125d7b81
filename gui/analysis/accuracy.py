"""The page of a figure of curves, such as accuracy over components; any point can be chosen."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from math import ceil
from typing import NamedTuple

import numpy as np
import pyqtgraph as pg
from pyqtgraph.graphicsItems.ScatterPlotItem import Symbols
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, QRectF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import (
    QBrush,
    QHideEvent,
    QIcon,
    QKeyEvent,
    QPainter,
    QPainterPath,
    QPen,
    QPixmap,
    QResizeEvent,
    QShowEvent,
    QTransform,
)
from PySide6.QtWidgets import (
    QCheckBox,
    QGraphicsItem,
    QGraphicsView,
    QStyleOptionGraphicsItem,
    QWidget,
)

from gui.analysis.export import Picture, widget_picture
from gui.analysis.results import point_words
from gui.widgets.labels import label
from gui.widgets.layouts import (
    FlowLayout,
    combo_box,
    container,
    hbox,
    push_button,
    scroll_area,
    vbox,
)
from gui.widgets.plot_axes import (
    BOTTOM_PX,
    Plot,
    PlotGrid,
    Readout,
    add_plot,
    colour_axes,
    reserve,
    title_plot,
)
from gui.widgets.theme import DARK, Theme, scaled_px
from rigctl.analysis.report.figure import Figure, Panel, Series

SAMPLE = QSize(34, 14)
SYMBOL_PX, PAPER_PX = 8, 13
PAPER_SYMBOL = "d"
DASHES = (3.0, 2.0)


class CurveLook(NamedTuple):
    """The paper's colour on white and on black, dashes in widths of the line, a symbol or none."""

    light: str
    dark: str
    dashes: tuple[float, ...]
    symbol: str

    def colour(self, theme: Theme) -> str:
        """Return the colour in a theme."""
        return self.dark if theme is DARK else self.light

    def pen(self, theme: Theme) -> QPen:
        """Return the pen of the curve."""
        pen: QPen = pg.mkPen(self.colour(theme), width=2, dash=list(self.dashes) or None)
        return pen

    def sample(self, theme: Theme) -> QIcon:
        """Return a piece of the curve for a legend."""
        pixmap = QPixmap(SAMPLE * 2)
        pixmap.setDevicePixelRatio(2)
        pixmap.fill(Qt.GlobalColor.transparent)
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = SAMPLE.height() / 2
        painter.setPen(self.pen(theme))
        painter.drawLine(QPointF(0, middle), QPointF(SAMPLE.width(), middle))
        painter.translate(SAMPLE.width() / 2, middle)
        painter.setPen(pg.mkPen(self.colour(theme)))
        painter.setBrush(pg.mkBrush(theme.plot))
        painter.scale(SYMBOL_PX, SYMBOL_PX)
        painter.pen().setCosmetic(True)
        painter.drawPath(Symbols[self.symbol] if self.symbol else QPainterPath())
        painter.end()
        return QIcon(pixmap)


COLOURS = {
    "ink": ("#111111", "#e6e9ed"),
    "red": ("#c8102e", "#ff7a85"),
    "blue": ("#1f4fd1", "#86a8ff"),
    "green": ("#1a8a34", "#5fd07a"),
    "violet": ("#7a3fc4", "#b794f6"),
    "brown": ("#8a5a00", "#d3a04a"),
    "light-blue": ("#6387e6", "#4a68ad"),
    "light-green": ("#459e5e", "#3a8a50"),
    "teal": ("#007c80", "#4fc7c9"),
}
SYMBOLS_OF = {
    "ink": ("o", "h"),
    "red": ("t1", "t"),
    "blue": ("s", "d"),
    "green": ("star", "x"),
    "violet": ("p", "t2"),
    "brown": ("+", "t3"),
    "light-blue": ("d", "d"),
    "light-green": ("x", "x"),
    "teal": ("arrow_up", "arrow_down"),
}
"""Symbols of curves that are drawn through, and of dashed ones."""


def look_of(curve: Series) -> CurveLook:
    """Return how a curve is drawn."""
    symbol = SYMBOLS_OF[curve.colour][curve.dashed]
    return CurveLook(*COLOURS[curve.colour], DASHES if curve.dashed else (), symbol)


SYMBOLS = 8
ROOM, MARGIN = 1.04, 0.07
"""Where a plot ends above its largest value, and the share of its width right of the curves."""
_SMOOTH = QPainter.RenderHint.Antialiasing


class AccuracyCurves(QGraphicsItem):
    """Draws curves with bars, a symbol at some of their points, and the paper's values."""

    def __init__(self, panel: Panel, hidden: AbstractSet[str], theme: Theme) -> None:
        super().__init__()
        self._last = last_x(panel)
        self._rect = QRectF(0, 0, (1 + MARGIN) * self._last, ROOM * panel.y_range[1])
        self._lines: list[tuple[QPen, QPainterPath, bool]] = []
        self._symbols: list[tuple[QPen, QBrush, QPainterPath, list[QPointF]]] = []
        for curve in panel.series:
            if curve.name not in hidden:
                self._add_curve(curve, theme)
                self._add_paper(curve, theme)

    def boundingRect(self) -> QRectF:
        """Return the whole plot."""
        return self._rect

    def paint(
        self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None
    ) -> None:
        """Draw the lines, and above them the symbols, which no axis stretches."""
        painter.save()
        for pen, path, is_smooth in self._lines:
            painter.setRenderHint(_SMOOTH, is_smooth)
            painter.setPen(pen)
            painter.drawPath(path)
        painter.setRenderHint(_SMOOTH)
        to_scene = self.sceneTransform()
        painter.setTransform(to_scene.inverted()[0], True)
        for pen, brush, path, points in self._symbols:
            painter.setPen(pen)
            painter.setBrush(brush)
            for point in points:
                painter.drawPath(path.translated(to_scene.map(point)))
        painter.restore()

    def _add_curve(self, curve: Series, theme: Theme) -> None:
        look = look_of(curve)
        colour = look.colour(theme)
        x, y = np.array(curve.x, np.float64), np.array(curve.y)
        if curve.spread is not None:
            ends = np.array([curve.ends(i) for i in range(len(x))])
            bars = pg.arrayToQPath(np.repeat(x, 2), ends.ravel(), connect="pairs")
            self._lines.append((pg.mkPen(colour, width=1), bars, False))
        self._lines.append((look.pen(theme), pg.arrayToQPath(x, y), True))
        points = [QPointF(*at) for at in zip(curve.x, curve.y, strict=True)]
        some = points[:: ceil(len(points) / SYMBOLS)]
        symbol = _symbol(look.symbol, SYMBOL_PX)
        pen = pg.mkPen(colour, width=1.5)
        self._symbols.append((pen, pg.mkBrush(theme.plot), symbol, some))

    def _add_paper(self, curve: Series, theme: Theme) -> None:
        """Mark the paper's values, right of shorter curves, hollow for a dashed one."""
        colour = look_of(curve).colour(theme)
        inside, edge = (theme.plot, colour) if curve.dashed else (colour, theme.plot)
        right = (1 + MARGIN / 2) * self._last
        places = [QPointF(x if x <= self._last else right, y) for x, y, _ in curve.published]
        mark = _symbol(PAPER_SYMBOL, PAPER_PX)
        self._symbols.append((pg.mkPen(edge, width=1), pg.mkBrush(inside), mark, places))


def last_x(panel: Panel) -> float:
    """Return where the longest curve ends."""
    return float(max(max(one.x) for one in panel.series))


def _symbol(name: str, size_px: float) -> QPainterPath:
    path: QPainterPath = QTransform.fromScale(size_px, size_px).map(Symbols[name])
    return path


LEFT_PX, TITLE_PX = 44, 20
TICK_PX, FEW_TICKS = 16, (50.0, 10.0)
"""Height of a number of an axis, and the steps with and without numbers in a low plot, in %."""
LETTER_PX = 7
"""Of the name of an axis, which is the unit alone where the plot is too low."""
PLOT_PX = 215
"""Least width of a plot, for its title: four fit beside a scroll bar at 1280 pixels."""
ROW_PX, ROOMY_ROW_PX = 108, 166
"""Least height of a row of plots with title and axis: all in one view, or in one that scrolls."""
GAP_PX = 4
ZOOM = 1.25
_Key = Qt.Key
_UPDATE = QGraphicsView.ViewportUpdateMode


class AccuracyPoint(NamedTuple):
    """A point: indices of the panel, of the curve in it, and of the place on the curve."""

    panel: int = 0
    curve: int = 0
    place: int = 0


class AccuracyPlots(PlotGrid):
    """The plots of the tasks that are shown. Pointer and arrow keys choose a point.

    They are made when they come into view, one in each turn of the event loop: the plots of all
    tasks take some tenths of a second, and STOP would wait.
    """

    point_changed = Signal(str)
    """The chosen point in words, empty for none."""

    def __init__(self, theme: Theme, figure: Figure) -> None:
        super().__init__()
        self._theme, self.panels = theme, figure.plots
        self.hidden: AbstractSet[str] = frozenset()
        self.alone: int | None = None
        self.point: AccuracyPoint | None = None
        self.plots: dict[int, Plot] = {}
        self.cells.setSpacing(GAP_PX)
        self.cells.setContentsMargins(GAP_PX, GAP_PX, GAP_PX, GAP_PX)
        self._n_columns = 0
        self._timer = QTimer(self, interval=0)
        self._timer.timeout.connect(self._add_next)
        self._ring = pg.ScatterPlotItem()
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.graphics.installEventFilter(self)
        self.graphics.setAccessibleName(figure.title)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour(theme)
        self._lay_out()

    def show_alone(self, panel: int | None) -> None:
        """Show one task large, or all."""
        self.alone = panel
        self._lay_out()

    def hide_curves(self, names: AbstractSet[str]) -> None:
        """Leave out the curves of these names."""
        self.hidden = names
        for number in self.plots:
            self._draw(number)
        self._choose(None)

    def show_whole_range(self) -> None:
        """Undo the zoom."""
        for number in self.plots:
            self._show_whole(number)

    @property
    def is_whole(self) -> bool:
        """Whether every plot is made."""
        return len(self.plots) == len(self._shown_panels())

    def make_all(self) -> None:
        """Make the plots that are missing, as for a picture."""
        while not self.is_whole:
            self._add_next()
        for grid in (self.cells.layout, *(plot.grid for plot in self.plots.values())):
            grid.activate()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take the keys that choose a point or zoom."""
        if isinstance(event, QKeyEvent) and event.type() is QEvent.Type.KeyPress:
            return self._press(event)
        return super().eventFilter(watched, event)

    def sizeHint(self) -> QSize:
        """Return the least size: the plots take the room that there is."""
        return self.minimumSize()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put as many plots beside each other as the new width has room for."""
        super().resizeEvent(event)
        if columns_of(len(self._shown_panels()), self.width()) != self._n_columns:
            self._lay_out()

    def showEvent(self, event: QShowEvent) -> None:
        """Go on to make the plots."""
        super().showEvent(event)
        self._timer.start()

    def hideEvent(self, event: QHideEvent) -> None:
        """Make no more plots that nobody sees."""
        super().hideEvent(event)
        self._timer.stop()

    def _shown_panels(self) -> Sequence[int]:
        return range(len(self.panels)) if self.alone is None else [self.alone]

    def _lay_out(self) -> None:
        """Make the plots anew, in a grid."""
        self.cells.clear()
        self.plots.clear()
        panels = self._shown_panels()
        self._n_columns = columns_of(len(panels), self.width())
        is_narrow = self._n_columns < wanted_columns(len(panels))
        row_px = scaled_px(ROOMY_ROW_PX if is_narrow else ROW_PX)
        self.setMinimumSize(scaled_px(PLOT_PX), row_px * ceil(len(panels) / self._n_columns))
        self._choose(None)
        self.graphics.setViewportUpdateMode(_UPDATE.NoViewportUpdate)  # one is of all plots
        if self.isVisible():
            self._timer.start()

    def _add_next(self) -> None:
        """Add the next plot; the last one shows all of them."""
        if not self.is_whole:
            place = len(self.plots)
            number, cell = self._shown_panels()[place], divmod(place, self._n_columns)
            self.plots[number] = self._add(*cell, self.panels[number])
            self._draw(number)
            self._show_whole(number)
        if self.is_whole:
            self._timer.stop()
            self.graphics.setViewportUpdateMode(_UPDATE.MinimalViewportUpdate)
            self.graphics.viewport().update()

    def _show_whole(self, number: int) -> None:
        panel = self.panels[number]
        x, y = (0, (1 + MARGIN) * last_x(panel)), (0, ROOM * panel.y_range[1])
        self.plots[number].getViewBox().setRange(xRange=x, yRange=y, padding=0)

    def _add(self, row: int, column: int, panel: Panel) -> Plot:
        plot = add_plot(self.cells, row, column)
        view = plot.getViewBox()
        view.disableAutoRange()
        view.setLimits(
            xMin=0, xMax=(1 + MARGIN) * last_x(panel), yMin=0, yMax=ROOM * panel.y_range[1]
        )
        view.setLimits(minXRange=2, minYRange=2)
        title_plot(plot, panel.title, self._theme.text)
        plot.grid.addItem(plot.titleLabel, 0, 0, 1, 3)  # a long title needs the axis's width
        plot.grid.setRowFixedHeight(0, scaled_px(TITLE_PX))
        is_named = not column or panel.y_label != self.panels[0].y_label
        if is_named:
            plot.setLabel("left", _name(panel.y_label))
            plot.getViewBox().sigResized.connect(lambda *_: _name_axis(plot, panel))
        plot.setLabel("bottom", _name(panel.x_label))
        reserve(plot, "left", LEFT_PX if is_named else LEFT_PX - 14)
        reserve(plot, "bottom", BOTTOM_PX)
        for changed in (view.sigResized, view.sigYRangeChanged):
            changed.connect(lambda *_: _space_ticks(plot, panel))
        colour_axes(plot, self._theme)
        return plot

    def _draw(self, number: int) -> None:
        plot, panel = self.plots[number], self.panels[number]
        plot.clear()
        dots = pg.mkPen(self._theme.muted, width=1, style=Qt.PenStyle.DotLine)
        if panel.level is not None:
            plot.addItem(pg.InfiniteLine(panel.level[0], angle=0, pen=dots))
        plot.addItem(AccuracyCurves(panel, self.hidden, self._theme))

    def _point_at(self, place: QPointF) -> None:
        for number, plot in self.plots.items():
            view = plot.getViewBox()
            if view.sceneBoundingRect().contains(place):
                at = view.mapSceneToView(place)
                self._choose(self._nearest(number, at.x(), at.y()))
                return

    def _nearest(self, number: int, x: float, y: float) -> AccuracyPoint | None:
        """Return the point of a shown curve that is nearest in height at the nearest x."""
        curves, points = self.panels[number].series, []
        for i in self._shown(number):
            at = min(range(len(curves[i].x)), key=lambda k: abs(curves[i].x[k] - x))
            points.append(AccuracyPoint(number, i, at))
        return min(
            points,
            key=lambda one: (
                round(abs(curves[one.curve].x[one.place] - x)),
                abs(curves[one.curve].y[one.place] - y),
            ),
            default=None,
        )

    def chosen_place(self) -> QPoint | None:
        """Return the middle of the plot with the chosen point, in pixels of this widget."""
        if self.point is None:
            return None
        centre: QPointF = self.plots[self.point.panel].sceneBoundingRect().center()
        return centre.toPoint()

    def _shown(self, number: int) -> list[int]:
        curves = self.panels[number].series
        return [i for i, curve in enumerate(curves) if curve.name not in self.hidden]

    def _choose(self, point: AccuracyPoint | None) -> None:
        self.point = point
        if (view := self._ring.getViewBox()) is not None:
            view.removeItem(self._ring)
        words = ""
        if point is not None:
            panel = self.panels[point.panel]
            curve = panel.series[point.curve]
            words = point_words(panel, curve, point.place)
            self._ring = pg.ScatterPlotItem(
                [curve.x[point.place]],
                [curve.y[point.place]],
                size=14,
                brush=None,
                pen=pg.mkPen(self._theme.accent, width=3),
            )
            self.plots[point.panel].addItem(self._ring)
        self.point_changed.emit(words)

    def _press(self, event: QKeyEvent) -> bool:
        key = event.key()
        if key in (_Key.Key_Plus, _Key.Key_Equal, _Key.Key_Minus):
            self._zoom(ZOOM if key == _Key.Key_Minus else 1 / ZOOM)
        elif key == _Key.Key_0:
            self.show_whole_range()
        else:
            return self._step(key)
        return True

    def _step(self, key: int) -> bool:
        """Go to another point; the first key chooses the first point."""
        if not (numbers := list(self.plots)):
            return False
        point = self.point or AccuracyPoint(numbers[0], (self._shown(numbers[0]) or [0])[0])
        sideways = {_Key.Key_Left: -1, _Key.Key_Right: 1, _Key.Key_Home: -9999, _Key.Key_End: 9999}
        if key in sideways:
            step = sideways[_Key(key)] if self.point else 0
            point = point._replace(place=point.place + step)
        elif key in (_Key.Key_Up, _Key.Key_Down):
            shown = self._shown(point.panel)
            step = (-1 if key == _Key.Key_Up else 1) if self.point else 0
            if shown:
                at = shown.index(point.curve) + step
                point = point._replace(curve=shown[min(max(at, 0), len(shown) - 1)])
        elif key in (_Key.Key_PageUp, _Key.Key_PageDown):
            at = numbers.index(point.panel) + (-1 if key == _Key.Key_PageUp else 1)
            point = point._replace(panel=numbers[min(max(at, 0), len(numbers) - 1)])
        else:
            return False
        self._choose(self._valid(point))
        return True

    def _valid(self, point: AccuracyPoint) -> AccuracyPoint | None:
        """Return the point within its panel and its curve; None where no curve is shown."""
        shown = self._shown(point.panel)
        if not shown:
            return None
        curve = point.curve if point.curve in shown else shown[0]
        last = len(self.panels[point.panel].series[curve].x) - 1
        return AccuracyPoint(point.panel, curve, min(max(point.place, 0), last))

    def _zoom(self, factor: float) -> None:
        """Zoom about the chosen point, or about the middle of every plot."""
        point = self.point
        centre = None
        if point is not None:
            curve = self.panels[point.panel].series[point.curve]
            centre = pg.Point(curve.x[point.place], curve.y[point.place])
        for number, plot in self.plots.items():
            if point is None or number == point.panel:
                plot.getViewBox().scaleBy((factor, factor), center=centre)


def wanted_columns(n_plots: int) -> int:
    """Return how many plots stand beside each other where there is room for all."""
    n_rows = 1 if n_plots <= 2 else 2 if n_plots <= 8 else 3
    return ceil(n_plots / n_rows)


def columns_of(n_plots: int, width_px: int) -> int:
    """Return how many plots stand beside each other in a width."""
    fit = (width_px - GAP_PX) // (scaled_px(PLOT_PX) + GAP_PX)
    return max(1, min(wanted_columns(n_plots), fit))


def _space_ticks(plot: Plot, panel: Panel) -> None:
    """Number every 50 % where the numbers of every 20 % would lie over each other."""
    view = plot.getViewBox()
    low, high = view.viewRange()[1]
    is_crowded = (high - low) / 20 * scaled_px(TICK_PX) > view.height()
    is_percent = panel.y_range[1] == 100
    plot.getAxis("left").setTickSpacing(*(FEW_TICKS if is_crowded and is_percent else ()))


def _name(label: str) -> str:
    return label[:1].upper() + label[1:]


def _name_axis(plot: Plot, panel: Panel) -> None:
    """Give the axis the name that the plot has room for."""
    has_room = plot.getViewBox().height() >= scaled_px(LETTER_PX * len(panel.y_label))
    name = _name(panel.y_label) if has_room else panel.unit
    axis = plot.getAxis("left")
    if axis.labelText != name:
        axis.setLabel(name)
        axis.resizeEvent()  # pyqtgraph places a label only when its axis has another size


HINT = (
    "Point at a curve to read it, or use the keys: left and right along it, up and down "
    "for the curve, Page up and Page down for the plot, + and − to zoom, 0 for the whole range."
)


class AccuracyPage(QWidget):
    """Curves that the legend switches on and off."""

    def __init__(self, theme: Theme, figure: Figure, origin: str) -> None:
        super().__init__()
        self.plots = AccuracyPlots(theme, figure)
        titles = {panel.title: f"{number}" for number, panel in enumerate(figure.plots)}
        self.task = combo_box({"All plots": "", **titles} if len(titles) > 1 else titles)
        self.task.setAccessibleName("Plot")
        self.whole_button = push_button(
            "Whole range", self.plots.show_whole_range, "Undo the zoom (0)"
        )
        self.readout = Readout(self.plots.graphics, HINT)
        self.legend = {name: QCheckBox(name) for name in figure.legend}
        self._curves = figure.legend
        self._lay_out(f"{_marks(figure)} {origin}")
        self.set_theme(theme)
        self.task.currentIndexChanged.connect(lambda _: self._show_task())
        self.plots.point_changed.connect(self._show_point)
        for box in self.legend.values():
            box.toggled.connect(lambda _: self._hide_curves())

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)
        for name, box in self.legend.items():
            box.setIcon(look_of(self._curves[name]).sample(theme))

    def picture(self) -> Picture:
        """Return legend, plots and origin as a picture."""
        self.plots.make_all()
        return widget_picture(self._figure)

    def _show_task(self) -> None:
        number = self.task.currentData()
        self.plots.show_alone(int(number) if number else None)

    def _show_point(self, words: str) -> None:
        """Say what the point is, and scroll to its plot."""
        self.readout.show_words(words)
        if (place := self.plots.chosen_place()) is not None:
            at = self.plots.mapTo(self._figure, place)
            self._area.ensureVisible(at.x(), at.y(), 0, ROW_PX // 2)

    def _hide_curves(self) -> None:
        hidden = frozenset(name for name, box in self.legend.items() if not box.isChecked())
        self.plots.hide_curves(hidden)

    def _lay_out(self, notes: str) -> None:
        for box in self.legend.values():
            box.setChecked(True)
            box.setIconSize(SAMPLE)
            box.setToolTip("Show or hide this curve")
        origin = label(notes, "muted", wraps=True)
        column = vbox(FlowLayout(*self.legend.values()), self.plots, origin, spacing=2)
        column.setContentsMargins(8, 0, 8, 0)
        column.setStretch(1, 1)
        self._figure = container(column)
        head = hbox(self.task, self.whole_button, margins=(8, 6, 8, 2))
        self._area = scroll_area(self._figure)
        self.setLayout(vbox(head, self._area, self.readout, tall=1))


def _marks(figure: Figure) -> str:
    """Return what bars, marks and dots are, as far as there are any."""
    has_paper = any(curve.published for panel in figure.plots for curve in panel.series)
    paper = ["◆: the paper's value."] if has_paper else []
    dotted = {panel.level[1].partition(" ")[0] for panel in figure.plots if panel.level}
    return " ".join([*figure.notes[:1], *paper, *(f"Dotted: {what}." for what in sorted(dotted))])
