"""What only the bench itself can do: which plate is on, and the simulated bench's faults."""

from __future__ import annotations

from string import ascii_uppercase

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QGridLayout, QGroupBox, QLabel, QPushButton

from gui.status import Status

TEXTURES = tuple(ascii_uppercase[:16])
FAULTS = {
    "Press the E-stop": "press_estop",
    "Release the E-stop": "release_estop",
    "Unplug the drum": "unplug_drum",
    "Plug the drum in": "replug_drum",
    "Unplug the taxels": "unplug_taxels",
    "Plug the taxels in": "replug_taxels",
    "Silence the load cell": "loadcell_silent",
    "Push with 2 kg": "push",
}


class Bench(QGroupBox):
    """The plate in use; on a simulated rig also things that go wrong, to rehearse them."""

    plate_asked = Signal(str)
    inject_asked = Signal(str)

    def __init__(self) -> None:
        super().__init__("Bench")
        self.plate = QComboBox()
        self.plate.addItems(list(TEXTURES))
        self.plate.setToolTip("Texture plate that is on the drum")
        self.plate.activated.connect(lambda: self.plate_asked.emit(self.plate.currentText()))
        self.fault = QComboBox()
        for text, name in FAULTS.items():
            self.fault.addItem(text, name)
        self.inject = QPushButton("Do it")
        self.inject.clicked.connect(lambda: self.inject_asked.emit(self.fault.currentData()))
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 8)
        grid.addWidget(QLabel("Plate"), 0, 0)
        grid.addWidget(self.plate, 0, 1, 1, 2)
        self._simulated_name = QLabel("Fault")
        for place, widget in enumerate((self._simulated_name, self.fault, self.inject)):
            grid.addWidget(widget, 1, place)
        grid.setColumnStretch(1, 1)

    def show_status(self, status: Status) -> None:
        """Show the plate; offer faults where they are only simulated."""
        self.plate.setEnabled(status.drum_connected and not status.run.is_going)
        for widget in (self._simulated_name, self.fault, self.inject):
            widget.setVisible(status.simulated)
        if status.texture and not self.plate.view().isVisible():
            self.plate.setCurrentText(status.texture)
