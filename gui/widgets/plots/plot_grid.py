"""A widget with plots of pyqtgraph in a grid."""

from __future__ import annotations

from html import escape
from math import ceil

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from gui.widgets.layouts import vbox
from gui.widgets.plots.plot_axes import title_plot
from gui.widgets.theme import Theme, scaled_px

HEADING_PT = 10.0


class PlotGrid(QWidget):
    """Holds a pyqtgraph view: pyqtgraph has no types, so that a subclass of its would have none.

    ``graphics``: the view, which fills the widget. ``cells``: the layout of its plots.
    """

    def __init__(self) -> None:
        super().__init__()
        self.graphics = pg.GraphicsLayoutWidget()
        self.cells = self.graphics.ci
        self.setLayout(vbox(self.graphics, spacing=0, margins=(0, 0, 0, 0)))
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

    def show_heading(self, plot: pg.PlotItem, text: str, theme: Theme) -> None:
        """Write what all plots show above the first one, and keep room for it."""
        title_plot(plot, escape(text), theme.muted, HEADING_PT)
        plot.layout.addItem(plot.titleLabel, 0, 0, 1, 3)  # over the axis, too
        self.keep_readable()

    def colour_background(self, theme: Theme) -> None:
        """Give the space around the plots the colour of a panel."""
        self.graphics.setBackground(theme.panel)
