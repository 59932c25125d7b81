"""Controls of the bench: the mounted plate, and faults of a simulated bench."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import QComboBox, QGridLayout, QGroupBox, QLabel, QWidget

from gui.widgets.file_browser import ElidedComboBox
from gui.widgets.layouts import ComboBox, EventWatch, push_button
from gui.widgets.plates import World, picture_size, plate_icon, plate_words
from gui.widgets.theme import applied_theme, scaled_px
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.textures import plate_names
from rigctl.bench.wirings import WIRINGS
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.messages import EngineStatus

UNKNOWN_PLATE = "unknown"
NOMINAL = WorldParameters()
_BAR_PX = 24
_RESTING = (State.IDLE, State.ARMED, State.FAULT_OFF)
FAULTS: dict[str, dict[str, Any]] = {
    "Press the E-stop": {"fault": "press_estop"},
    "Release the E-stop": {"fault": "release_estop"},
    "Silence the load cell": {"fault": "loadcell_silent", "on": True},
    "Restore the load cell": {"fault": "loadcell_silent", "on": False},
    "Push with 2 kg": {"fault": "push", "force_g": 2000.0},
    "Stop pushing": {"fault": "push", "force_g": 0.0},
    "Jam the motor": {"fault": "jam_motor", "on": True},
    "Free the motor": {"fault": "jam_motor", "on": False},
    "Unplug the drum": {"fault": "unplug", "board": "drum"},
    "Plug in the drum": {"fault": "replug", "board": "drum"},
    "Unplug the taxels": {"fault": "unplug", "board": "taxels"},
    "Plug in the taxels": {"fault": "replug", "board": "taxels"},
}
"""Text of each fault that can be injected, and the arguments of the engine's command."""

WRONGLY, AS_DRAWN = "Wire wrongly", "Wire as drawn"
WIRINGS_ON_OFF: dict[str, dict[str, Any]] = {
    f"{text}: {name}": {"fault": "wire", "name": name, "on": is_on}
    for name in WIRINGS
    for text, is_on in ((WRONGLY, True), (AS_DRAWN, False))
}
"""The same for the wrong wirings of the catalogue."""


class BenchControls(QGroupBox):
    """The mounted plate, and on a simulated rig the faults that users can inject."""

    command_requested = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__("Bench")
        narrow = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
        self.plate = ElidedComboBox()
        self.plate.setPlaceholderText(UNKNOWN_PLATE)
        self.plate.setSizeAdjustPolicy(narrow)
        self.plate.setMinimumContentsLength(8)
        self._world: World = None
        self._look: tuple[object, ...] = ()
        self._list_plates()
        self.plate.activated.connect(self._send_plate)
        EventWatch(self, self._list_plates, QEvent.Type.PaletteChange, QEvent.Type.FontChange)
        self.fault = ComboBox()
        self.fault.addItems(list(FAULTS))
        self.inject = push_button("Inject", self._inject)
        self.inject.setAccessibleName("Inject the chosen fault")
        self.wiring = ElidedComboBox()
        self.wiring.setSizeAdjustPolicy(narrow)
        self.wiring.setMinimumContentsLength(8)
        for wiring in WIRINGS.values():
            self.wiring.addItem(wiring.name)
            self.wiring.setItemData(
                self.wiring.count() - 1, wiring.text, Qt.ItemDataRole.ToolTipRole
            )
        self.wiring.currentTextChanged.connect(self._show_wiring)
        self.wire = push_button(WRONGLY, self._wire)
        self.wire.setAccessibleName("Switch the chosen wrong wiring on or off")
        self._wirings_on: tuple[str, ...] = ()
        self._show_wiring()
        EventWatch(self.wiring, self._show_wiring, QEvent.Type.FontChange)
        fault_label, wiring_label = QLabel("Fault"), QLabel("Wiring")
        self._simulated_only: tuple[QWidget, ...] = (fault_label, self.fault, self.inject)
        self._simulated_only += (wiring_label, self.wiring, self.wire)
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 8)
        grid.addWidget(QLabel("Plate"), 0, 0)
        grid.addWidget(self.plate, 0, 1, 1, 2)
        grid.addWidget(fault_label, 1, 0)
        grid.addWidget(self.fault, 1, 1)
        grid.addWidget(self.inject, 1, 2)
        grid.addWidget(wiring_label, 2, 0)
        grid.addWidget(self.wiring, 2, 1, 1, 2)
        grid.addWidget(self.wire, 3, 1, 1, 2)
        grid.setColumnStretch(1, 1)

    def show_status(self, status: EngineStatus) -> None:
        """Show the plate, and the faults on a simulated rig."""
        obstacle = plate_obstacle(status)
        self.plate.setEnabled(not obstacle)
        locked = obstacle and f". Locked: {obstacle}"
        self.plate.set_own_tooltip(f"Texture plate on the drum{locked}")
        for widget in self._simulated_only:
            widget.setVisible(status.simulated)
        if status.wrong_wirings != self._wirings_on:
            self._wirings_on = status.wrong_wirings
            self._show_wiring()
        if not self.plate.view().isVisible():
            self._show_plate(status.texture)

    def _show_plate(self, texture: str | None) -> None:
        """Show the plate that the engine knows of, which may have any name, or that none is."""
        if texture and self.plate.findData(texture) < 0:
            self.plate.addItem(texture, texture)
        self.plate.setCurrentIndex(self.plate.findData(texture) if texture else -1)

    def set_world(self, world: World) -> None:
        """Offer the plates of another rig."""
        self._world = world
        self._list_plates()

    def _list_plates(self) -> None:
        """List the plates with their pictures, unless they are as they would be drawn now."""
        look = (self._world, applied_theme().text, self.plate.font(), picture_size())
        if look == self._look:
            return
        self._look = look
        chosen = self.plate.currentData()
        self.plate.clear()
        self.plate.setIconSize(picture_size())
        for name in plate_names(self._world or NOMINAL):
            icon = plate_icon(name, self._world)
            self.plate.addItem(icon, plate_words(name, self._world), name)
        self._show_plate(chosen)
        widest_px = self.plate.view().sizeHintForColumn(0) + scaled_px(_BAR_PX)
        self.plate.view().setMinimumWidth(widest_px)

    def _send_plate(self) -> None:
        self.command_requested.emit("plate", {"texture": self.plate.currentData()})

    def _show_wiring(self) -> None:
        """Show whether the chosen wiring is on, and in its list which others are."""
        for row in range(self.wiring.count()):
            font = self.wiring.font()
            font.setBold(self.wiring.itemText(row) in self._wirings_on)
            self.wiring.setItemData(row, font, Qt.ItemDataRole.FontRole)
        is_on = self.wiring.currentText() in self._wirings_on
        self.wire.setText(AS_DRAWN if is_on else WRONGLY)
        self.wiring.set_own_tooltip(WIRINGS[self.wiring.currentText()].text)

    def _wire(self) -> None:
        self.command_requested.emit(
            "inject", WIRINGS_ON_OFF[f"{self.wire.text()}: {self.wiring.currentText()}"]
        )

    def _inject(self) -> None:
        self.command_requested.emit("inject", FAULTS[self.fault.currentText()])


def plate_obstacle(status: EngineStatus) -> str:
    """Return why nobody can change the plate now; empty if somebody can."""
    if not status.drum_connected or status.state is None:
        return "no drum is connected"
    if status.run.is_active:
        return "a protocol is running"
    if status.is_left_in_contact:
        return "lift the drum first: it is in contact"
    return "" if status.state in _RESTING else "the drum moves"
