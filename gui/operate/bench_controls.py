"""What only the bench itself can do: which plate is on, and the simulated bench's faults."""

from __future__ import annotations

from string import ascii_uppercase
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QGridLayout, QGroupBox, QLabel, QPushButton

from rigctl.acquisition.rpc.messages import EngineStatus

TEXTURES = tuple(ascii_uppercase[:16])
FAULTS: dict[str, tuple[str, dict[str, Any]]] = {
    "Press the E-stop": ("press_estop", {}),
    "Release the E-stop": ("release_estop", {}),
    "Silence the load cell": ("loadcell_silent", {"on": True}),
    "Load cell speaks again": ("loadcell_silent", {"on": False}),
    "Push with 2 kg": ("push", {"force_g": 2000.0}),
    "Stop pushing": ("push", {"force_g": 0.0}),
    "Jam the motor": ("jam_motor", {"on": True}),
    "Free the motor": ("jam_motor", {"on": False}),
    "Unplug the drum": ("unplug", {"board": "drum"}),
    "Plug the drum in": ("replug", {"board": "drum"}),
    "Unplug the taxels": ("unplug", {"board": "taxels"}),
    "Plug the taxels in": ("replug", {"board": "taxels"}),
}
"""What can be made to happen: the words, the engine's name for it and its arguments."""


class BenchControls(QGroupBox):
    """The plate in use; on a simulated rig also things that go wrong, to rehearse them."""

    plate_asked = Signal(str)
    inject_asked = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__("Bench")
        self.plate = QComboBox()
        self.plate.addItems(list(TEXTURES))
        self.plate.setToolTip("Texture plate that is on the drum")
        self.plate.activated.connect(lambda: self.plate_asked.emit(self.plate.currentText()))
        self.fault = QComboBox()
        self.fault.addItems(list(FAULTS))
        self.inject = QPushButton("Do it")
        self.inject.clicked.connect(self._inject_clicked)
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 8)
        grid.addWidget(QLabel("Plate"), 0, 0)
        grid.addWidget(self.plate, 0, 1, 1, 2)
        self._simulated_name = QLabel("Fault")
        for place, widget in enumerate((self._simulated_name, self.fault, self.inject)):
            grid.addWidget(widget, 1, place)
        grid.setColumnStretch(1, 1)

    def _inject_clicked(self) -> None:
        self.inject_asked.emit(*FAULTS[self.fault.currentText()])

    def show_status(self, status: EngineStatus) -> None:
        """Show the plate; offer faults where they are only simulated."""
        self.plate.setEnabled(status.drum_connected and not status.run.is_active)
        for widget in (self._simulated_name, self.fault, self.inject):
            widget.setVisible(status.simulated)
        if status.texture and not self.plate.view().isVisible():
            self.plate.setCurrentText(status.texture)
