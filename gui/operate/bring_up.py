"""Bring-up: what is missing before approach, a button for the next step, and a list of all."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QGroupBox, QLabel, QPushButton

from gui.widgets.labels import Level, StatusLamp, label, set_property, show_text
from gui.widgets.layouts import container, push_button
from rigctl.boards.drum_states import State
from rigctl.engine.calibration_values import LOADCELL, WIRING
from rigctl.engine.rpc.messages import EngineStatus

CALIBRATE_TIP = "Calibrate load cell and force loop, measure the imbalance, identify the taxels"
STEPS, STEPS_TIP = "All steps", "List each step of the bring-up, and whether it is done"
SETUP = "setup"
READY = "Ready to approach"
_ON = (State.ARMED, State.POSITION, State.APPROACH, State.HOLD, State.RUN, State.RETRACT)


class BringUpStep(NamedTuple):
    """A step: whether it is done, in words, and the command that does it.

    ``part``: the part of the page Calibrate, or the page Set up, that does it, empty for a
    command. ``is_needed``: the drum cannot approach without it.
    """

    name: str
    is_done: bool
    words: str
    command: str = ""
    part: str = ""
    is_needed: bool = False


def bring_up_steps(status: EngineStatus) -> list[BringUpStep]:
    """Return the steps in their order."""
    taxels = status.boards.get("taxels")
    findings = taxels.self_test if taxels is not None else None
    is_on = status.drum_connected and status.state in _ON
    tested = "not run" if findings is None else _findings(len(findings))
    calibrated = status.loadcell_calibrated
    is_commissioned = status.commissioned
    return [
        BringUpStep(
            "Set up",
            is_commissioned,
            "commissioned" if is_commissioned else "not commissioned for its wiring",
            part=SETUP,
            is_needed=True,
        ),
        BringUpStep("Self-test", findings == (), tested, "test_taxels"),
        BringUpStep("Arm", is_on, "on" if is_on else "off", "arm", is_needed=True),
        BringUpStep("Home", status.homed, "homed" if status.homed else "angle unknown", "home"),
        BringUpStep(
            "Tare", status.tared, "tared" if status.tared else "no zero", "tare", is_needed=True
        ),
        BringUpStep(
            "Taxel range",
            status.has_taxel_range,
            "known" if status.has_taxel_range else "not measured",
            "calibrate_range",
        ),
        BringUpStep("Load cell", bool(calibrated), calibrated or "nominal scale", part=LOADCELL),
        BringUpStep(
            "Taxel order",
            status.has_taxel_order,
            "identified" if status.has_taxel_order else "as drawn, not identified",
            part=WIRING,
        ),
    ]


def _findings(n: int) -> str:
    return "no findings" if not n else f"{n} finding{'s' if n > 1 else ''}"


def missing_words(steps: list[BringUpStep]) -> str:
    """Return what is missing before approach in one sentence."""
    missing = [step.name.lower() for step in steps if step.is_needed and not step.is_done]
    return f"Before approach: {', '.join(missing)}" if missing else READY


class BringUpBox(QGroupBox):
    """The sentence before approach and the next step; a lamp and words for each step on request.

    It folds only when the user asks: buttons below it must not move under the mouse.
    """

    command_requested = Signal(str, dict)
    calibrate_requested = Signal(str)
    """Show this part of the page Calibrate."""
    setup_requested = Signal()
    """Show the page Set up."""

    def __init__(self) -> None:
        super().__init__("Bring-up")
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 8)
        grid.setVerticalSpacing(2)
        steps_grid = QGridLayout()
        self.rows: dict[str, tuple[StatusLamp, QLabel]] = {}
        for row, step in enumerate(bring_up_steps(EngineStatus())):
            lamp, words = StatusLamp(11), label("", "muted", wraps=True)
            self.rows[step.name] = (lamp, words)
            for column, widget in enumerate((lamp, label(step.name), words)):
                steps_grid.addWidget(widget, row, column)
        steps_grid.setColumnStretch(2, 1)
        self.list = container(steps_grid)
        self.list.hide()
        self.steps = QPushButton(STEPS)
        self.steps.setCheckable(True)
        self.steps.setToolTip(STEPS_TIP)
        self.steps.toggled.connect(self.list.setVisible)
        self.missing = label("", "heading", wraps=True)
        self.next = push_button("Next step", self._do_next, "Do the first step that is missing")
        show_page = partial(self.calibrate_requested.emit, LOADCELL)
        self.calibrate = push_button("Calibrate …", show_page, CALIBRATE_TIP)
        self._next_step: BringUpStep | None = None
        grid.addWidget(self.missing, 0, 0, 1, 2)
        grid.addWidget(self.next, 1, 0, 1, 2)
        grid.addWidget(self.calibrate, 2, 0)
        grid.addWidget(self.steps, 2, 1)
        grid.addWidget(self.list, 3, 0, 1, 2)

    def show_status(self, status: EngineStatus) -> None:
        """Show the steps; the next one can be done while no protocol runs."""
        steps = bring_up_steps(status)
        for step in steps:
            self._show_step(step)
        show_text(self.missing, missing_words(steps))
        undone = [step for step in steps if not step.is_done]
        self._next_step = undone[0] if undone else None
        self.next.setText(f"Next: {undone[0].name}" if undone else "All done")
        is_free = status.drum_connected and not (status.run.is_active or status.is_moved_by_hand)
        self.next.setEnabled(bool(undone) and is_free and not status.fault)

    def _show_step(self, step: BringUpStep) -> None:
        lamp, words = self.rows[step.name]
        lamp.set_level(Level.OK if step.is_done else Level.WARN if step.is_needed else Level.OFF)
        show_text(words, step.words)
        set_property(words, "role", "warn" if step.is_needed and not step.is_done else "muted")

    def _do_next(self) -> None:
        step = self._next_step
        if step is not None and step.part == SETUP:
            self.setup_requested.emit()
        elif step is not None and step.part:
            self.calibrate_requested.emit(step.part)
        elif step is not None:
            self.command_requested.emit(step.command, {})
