"""One part of a calibration: what to do, a measurement, its result, Save and Discard."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLayout, QPushButton, QVBoxLayout, QWidget

from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import push_button, vbox
from rigctl.acquisition.calibration.calibration_values import CalibrationStatus
from rigctl.acquisition.rpc.messages import EngineStatus

SAVE_TIP = "Save the result on the drum's board and, at a bench, in its rig.toml"
DISCARD_TIP = "Forget what was measured"
CANCEL_TIP = "End the measurement: the drum lifts and switches off"


class PartPage(QWidget):
    """A page with the buttons that every part has.

    A subclass adds its own widgets and says in :meth:`result` what was found, and in
    :meth:`obstacle` why nothing can be measured now.
    """

    command_requested = Signal(str, dict)
    """The engine's command and its arguments."""

    def __init__(self, part: str, measure_text: str, measure_tip: str) -> None:
        super().__init__()
        self.part = part
        self.task = label("", "heading", wraps=True)
        self.state = label("", "muted", wraps=True)
        self.result_label = label("", "heading", wraps=True)
        self.measure_button = push_button(measure_text, self.measure, measure_tip)
        self.cancel_button = push_button("Cancel", self._cancel, CANCEL_TIP)
        self.save_button = push_button("Save", self._save, SAVE_TIP)
        self.discard_button = push_button("Discard", self._discard, DISCARD_TIP)
        self._refusal = ""
        self.is_unsaved = False
        """Whether a bench has been measured, and nothing keeps what was found."""
        self.buttons = [
            *(self.measure_button, self.cancel_button, self.save_button, self.discard_button)
        ]

    def measure(self) -> None:
        """Send the command of the measurement."""
        raise NotImplementedError

    def result(self, found: CalibrationStatus) -> str:
        """Return what was found in words, empty without a result that can be saved."""
        raise NotImplementedError

    def has_readings(self, found: CalibrationStatus) -> bool:
        """Return whether there is something to discard."""
        return bool(self.result(found))

    def obstacle(self, status: EngineStatus) -> str:
        """Return why nothing can be measured now, empty where it can."""
        return common_obstacle(status)

    def show_status(self, status: EngineStatus) -> None:
        """Show what was measured and what is possible now."""
        found = status.calibration
        obstacle = self.obstacle(status)
        if not status.drum_connected:
            self._refusal = ""  # of another connection
        is_free = not obstacle and not found.measuring
        result, is_saved = self.result(found), self.part in found.saved
        self.is_unsaved = bool(found.rig_file) and self.has_readings(found) and not is_saved
        self.measure_button.setEnabled(is_free)
        self.cancel_button.setEnabled(bool(found.measuring))
        self.save_button.setEnabled(is_free and bool(result) and not is_saved)
        self.discard_button.setEnabled(is_free and self.has_readings(found))
        self._show_state(obstacle, found)
        saved = found.saved.get(self.part)
        show_text(self.result_label, f"{result}; saved in {saved}" if saved else result)

    def show_refusal(self, sentence: str) -> None:
        """Show why the engine refused; the next command of the part removes it."""
        self._refusal = sentence

    def send(self, command: str, **args: object) -> None:
        """Send a command of this part."""
        self._refusal = ""
        self.command_requested.emit(command, args)

    def lay_out(self, *rows: QWidget | QLayout, extra: tuple[QPushButton, ...] = ()) -> None:
        """Put the rows between the task and the buttons."""
        self.buttons.extend(extra)
        buttons = FlowLayout(self.measure_button, *extra, *self.buttons[1:4])
        column: QVBoxLayout = vbox(
            *(self.task, *rows, buttons, self.state, self.result_label),
            spacing=6,
            margins=(9, 6, 9, 6),
        )
        column.addStretch(1)
        self.setLayout(column)

    def _show_state(self, obstacle: str, found: CalibrationStatus) -> None:
        text, role = obstacle, "muted"
        if found.measuring:
            text = f"Measuring: {found.elapsed_s:.0f} s{_usual(found)}"
        elif self._refusal and not obstacle:
            text, role = self._refusal, "bad"
        show_text(self.state, text)
        set_property(self.state, "role", role)

    def _cancel(self) -> None:
        self.send("cancel_calibration")

    def _save(self) -> None:
        self.send("save_calibration", part=self.part)

    def _discard(self) -> None:
        self.send("discard_calibration", part=self.part)


def _usual(found: CalibrationStatus) -> str:
    """Return how long it takes, in words that follow the seconds that have passed."""
    if not found.usual_s:
        return ""
    if found.elapsed_s > found.usual_s:
        return f", longer than the usual {found.usual_s:.0f} s"
    return f" of about {found.usual_s:.0f} s"


def common_obstacle(status: EngineStatus) -> str:
    """Return why the drum cannot be used now, empty where it can."""
    if not status.drum_connected:
        return "Connect to a rig first."
    if status.run.is_active:
        return "A protocol is running: wait for its end, or abort it."
    if status.fault:
        return "Clear the fault first, in the panel Operate."
    if status.is_moved_by_hand and not status.calibration.measuring:
        return "The drum moves by hand: wait for its end."
    return ""
