"""A button for each taxel: which ones the views show."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QPushButton, QWidget

from gui.widgets.labels import label
from gui.widgets.layouts import container, hbox, push_button
from rigctl.session.header import SensorLayout

_COLUMNS = 9
_BUTTON_PX = 44


class TaxelStrip(QWidget):
    """Toggle buttons in rows of nine, and buttons for all and for each layer."""

    chosen = Signal(tuple)
    """The taxels to show, from 0; never empty."""

    def __init__(self, layout: SensorLayout) -> None:
        super().__init__()
        self._grid = QGridLayout()
        self._grid.setSpacing(3)
        self._grid.setContentsMargins(6, 0, 6, 0)
        self.setLayout(hbox(container(self._grid), label(), wide=1))
        self.buttons: list[QPushButton] = []
        self.groups: list[QPushButton] = []
        self.set_sensor_layout(layout)

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Offer the taxels of another sensor."""
        for button in (*self.buttons, *self.groups):
            self._grid.removeWidget(button)
            button.deleteLater()
        self.buttons = [self._taxel_button(taxel) for taxel in range(layout.n_taxels)]
        for taxel, button in enumerate(self.buttons):
            self._grid.addWidget(button, taxel // _COLUMNS, taxel % _COLUMNS)
        every = tuple(range(layout.n_taxels))
        groups = {"All": every}
        if len(layout.layers) > 1:
            layers = range(len(layout.layers))
            groups |= {f"Layer {layout.layers[i]}": tuple(layout.taxels_of(i)) for i in layers}
        self.groups = [
            push_button(name, partial(self._choose, taxels)) for name, taxels in groups.items()
        ]
        rows = -(-len(self.buttons) // _COLUMNS)
        for i, button in enumerate(self.groups):
            self._grid.addWidget(button, i % rows, _COLUMNS + i // rows)
        self.show_chosen(every)

    def show_chosen(self, taxels: tuple[int, ...]) -> None:
        """Press the buttons of these taxels."""
        for taxel, button in enumerate(self.buttons):
            button.setChecked(taxel in taxels)

    def _taxel_button(self, taxel: int) -> QPushButton:
        button = push_button(f"T{taxel + 1}", self._emit, f"Show taxel {taxel + 1}")
        button.setCheckable(True)
        button.setFixedWidth(_BUTTON_PX)
        return button

    def _choose(self, taxels: tuple[int, ...]) -> None:
        self.show_chosen(taxels)
        self._emit()

    def _emit(self) -> None:
        taxels = tuple(i for i, button in enumerate(self.buttons) if button.isChecked())
        if taxels:
            self.chosen.emit(taxels)
