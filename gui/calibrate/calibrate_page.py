"""The page Calibrate: load cell, force loop, imbalance and order of the taxels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QTabWidget, QWidget

from gui.calibrate.drum_parts import ForcePart, ImbalancePart
from gui.calibrate.load_cell_part import LoadCellPart
from gui.calibrate.part_page import PartPage
from gui.calibrate.wiring_part import WiringPart
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button, scroll_area, vbox
from rigctl.acquisition.calibration.calibration_values import (
    FORCE,
    IMBALANCE,
    LOADCELL,
    WIRING,
)
from rigctl.acquisition.rpc.messages import EngineStatus

COMMANDS = {
    "calibrate_loadcell": LOADCELL,
    "forget_mass": LOADCELL,
    "calibrate_force": FORCE,
    "calibrate_imbalance": IMBALANCE,
    "calibrate_wiring": WIRING,
    "repeat_press": WIRING,
}
"""The part to which each command of the engine belongs."""
TITLES = {LOADCELL: "Load cell", FORCE: "Force loop", IMBALANCE: "Imbalance", WIRING: "Taxel order"}


class CalibratePage(QWidget):
    """A tab for each part; it shows what the engine has measured, whoever asked for it."""

    command_requested = Signal(str, dict)
    closed = Signal()
    """The user wants to see the page from before."""

    def __init__(self) -> None:
        super().__init__()
        self.load_cell, self.force = LoadCellPart(), ForcePart()
        self.imbalance, self.wiring = ImbalancePart(), WiringPart()
        parts = (self.load_cell, self.force, self.imbalance, self.wiring)
        self.parts: dict[str, PartPage] = {part.part: part for part in parts}
        self._asked: dict[str, str] = {}
        """The part that each command was last about, where it has one as argument."""
        self.tabs = QTabWidget()
        for part in parts:
            self.tabs.addTab(scroll_area(part), TITLES[part.part])
            part.command_requested.connect(self._request)
        self.close_button = push_button("Close", self.closed.emit)
        heading = hbox(label("Calibrate", "heading"), self.close_button, spacing=8)
        column = vbox(heading, self.tabs, spacing=4, margins=(9, 4, 9, 4))
        column.setStretch(1, 1)
        self.setLayout(column)
        self.show_status(EngineStatus())

    @property
    def controls(self) -> list[QWidget]:
        """What acts on the rig."""
        return [button for part in self.parts.values() for button in part.buttons]

    @property
    def unsaved(self) -> list[str]:
        """Titles of the parts of a bench that are measured and not saved."""
        return [TITLES[name] for name, part in self.parts.items() if part.is_unsaved]

    def show_part(self, part: str) -> None:
        """Bring the tab of a part to the front."""
        self.tabs.setCurrentIndex(list(self.parts).index(part))

    def show_status(self, status: EngineStatus) -> None:
        """Show what was measured and what is possible now."""
        for part in self.parts.values():
            part.show_status(status)

    def show_refusal(self, command: str, sentence: str) -> None:
        """Show why the engine refused a command, in the part that it belongs to."""
        part = COMMANDS.get(command) or self._asked.get(command)
        if part is not None:
            self.parts[part].show_refusal(sentence)

    def show_answer(self, command: str, result: Mapping[str, Any]) -> None:
        """Show what a step of the identification found."""
        if command == "calibrate_wiring" and "found" in result:
            self.wiring.show_found(str(result["found"]))

    def _request(self, command: str, args: dict[str, Any]) -> None:
        if "part" in args:
            self._asked[command] = str(args["part"])
        self.command_requested.emit(command, args)
