"""A widget with plots of pyqtgraph in a grid."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from gui.widgets.layouts import vbox
from gui.widgets.theme import Theme


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

    def colour_background(self, theme: Theme) -> None:
        """Give the space around the plots the colour of a panel."""
        self.graphics.setBackground(theme.panel)
