"""The order of the taxels: which reading is which taxel, found by unplugging and pressing."""

from __future__ import annotations

from PySide6.QtWidgets import QSizePolicy

from gui.calibrate.part_page import PartPage
from gui.calibrate.sensor_map import SensorMap
from gui.widgets.labels import label, show_text
from gui.widgets.layouts import hbox, push_button, vbox
from rigctl.acquisition.calibration.calibration_values import WIRING, CalibrationStatus
from rigctl.acquisition.calibration.wiring_identification import N_STEPS, PER_LAYER
from rigctl.acquisition.calibration.words import wiring_words
from rigctl.acquisition.rpc.messages import EngineStatus

FLAT_STEP = 1
DONE_TIP = "Measure for one second, once you have done what is asked"
REPEAT_TIP = "Ask for the last place again"
LIFTS = " The drum lifts and switches off first: keep clear of it until it stands."
BY_ITSELF = " The simulated sensor is unplugged and pressed by itself."
REHEARSED = "a simulated rig has no rig.toml: this was a rehearsal"
LEGEND = (
    "Row 1 is at the top, column 1 at the left. ✓ is a known place, with its readings of the top "
    "and of the bottom layer."
)
ALL_KNOWN = "All taxels are identified."


class WiringPart(PartPage):
    """The step that is asked for, a map of the sensor, and what the last step found."""

    def __init__(self) -> None:
        super().__init__(WIRING, "Done, measure", DONE_TIP)
        self.map = SensorMap()
        self.map.setMaximumSize(460, 300)
        self.map.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self.found = label("", "muted", wraps=True)
        self.found.setMinimumWidth(120)
        self._found_before: int | None = None
        """Number of the step that followed what was found, None before a status tells it."""
        self.repeat_button = push_button("Repeat last", self._repeat, REPEAT_TIP)
        beside = vbox(label(LEGEND, "muted", wraps=True), self.found, spacing=8)
        beside.addStretch(1)
        self.lay_out(hbox(self.map, beside, spacing=12, wide=1), extra=(self.repeat_button,))

    def measure(self) -> None:
        """Measure the step."""
        self.send("calibrate_wiring")

    def result(self, found: CalibrationStatus) -> str:
        """Return the order."""
        return wiring_words(found.wiring) if found.wiring else ""

    def has_readings(self, found: CalibrationStatus) -> bool:
        """Return whether the identification has begun."""
        return found.wiring_step > 0

    def obstacle(self, status: EngineStatus) -> str:
        """Return why no step can be measured now."""
        if status.drum_connected and not status.taxels_connected:
            return "The taxel board is lost: check its cable."
        return super().obstacle(status)

    def show_status(self, status: EngineStatus) -> None:
        """Show the step, the map, and the order once it is known."""
        super().show_status(status)
        found = status.calibration
        show_text(self.task, _task(status))
        if self._found_before is None:
            self._found_before = found.wiring_step
        elif self._found_before != found.wiring_step:
            show_text(self.found, "")
        if found.wiring:
            self.measure_button.setEnabled(False)
        if found.wiring and not found.rig_file:
            self.save_button.setEnabled(False)
            show_text(self.result_label, f"{self.result(found)}; {REHEARSED}")
        pressed = bool(found.wiring_pressed)
        self.repeat_button.setEnabled(pressed and self.discard_button.isEnabled())
        self.map.show_places(_asked(found), found.wiring_pressed)

    def show_found(self, sentence: str) -> None:
        """Show what the last step found, until another one is taken or undone by anyone."""
        self._found_before = None
        show_text(self.found, sentence)

    def _repeat(self) -> None:
        self.send("repeat_press")


def _task(status: EngineStatus) -> str:
    found = status.calibration
    if not status.drum_connected:
        return "Find which reading is which taxel: unplug the bottom layer once, then press."
    if found.wiring:
        return ALL_KNOWN
    first = LIFTS if found.wiring_step == 0 else ""
    by_itself = BY_ITSELF if status.simulated else ""
    step = f"Step {found.wiring_step + 1} of {N_STEPS}. "
    return f"{step}{found.wiring_question}{first}{by_itself}"


def _asked(found: CalibrationStatus) -> tuple[int, ...]:
    """Return the places to press now."""
    if found.wiring_place is not None:
        return (found.wiring_place,)
    is_flat = found.wiring_step == FLAT_STEP and not found.wiring
    return tuple(range(PER_LAYER)) if is_flat else ()
