"""The force loop and the imbalance: the drum measures by itself."""

from __future__ import annotations

from gui.calibrate.imbalance_plot import ImbalancePlot
from gui.calibrate.part_page import PartPage
from gui.widgets.focus_wheel import focus_wheel
from gui.widgets.labels import label, show_text
from gui.widgets.layouts import hbox
from gui.widgets.number_box import NumberBox, has_refused
from rigctl.acquisition.calibration.calibration_values import (
    FORCE,
    IMBALANCE,
    CalibrationStatus,
)
from rigctl.acquisition.calibration.words import gains_words, imbalance_words
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.config.rig_config import RigLimits

FORCE_TASK = (
    "Mount a plate and keep clear of the drum. It lifts, tares, homes, presses with this force, "
    "makes a small step, lifts and switches off; its answer to the step gives the gains."
)
IMBALANCE_TASK = (
    "Take the plate off, or leave it on as in use, and keep clear of the drum. It lifts and turns "
    "once; the load cell's error in each sixteenth of the turn is taken out of later readings."
)
KEPT = "the board uses this table until it is switched off, and from then on only if it is saved"


class ForcePart(PartPage):
    """The force, and the gains that were found."""

    def __init__(self) -> None:
        super().__init__(FORCE, "Press and measure", "Find the gains of the force loop")
        self.force = focus_wheel(NumberBox(decimals=0, suffix=" g", singleStep=50))
        self.force.setAccessibleName("Force of the step test")
        self._limits: RigLimits | None = None
        self._set_limits(RigLimits())
        self.force.setValue(500.0)
        field = hbox(label("Force"), self.force, wide=-1, spacing=6)
        field.addStretch(1)
        show_text(self.task, FORCE_TASK)
        self.lay_out(field)

    def measure(self) -> None:
        """Press, step and lift."""
        if not has_refused(self.force):
            self.send("calibrate_force", force_g=self.force.value())

    def result(self, found: CalibrationStatus) -> str:
        """Return the gains."""
        return gains_words(found.gains) if found.gains is not None else ""

    def show_status(self, status: EngineStatus) -> None:
        """Show the gains; the force has the limits of the rig."""
        super().show_status(status)
        if status.drum_connected:
            self._set_limits(status.limits)
        self.force.setEnabled(self.measure_button.isEnabled())

    def _set_limits(self, limits: RigLimits) -> None:
        if limits != self._limits:
            self._limits = limits
            self.force.setRange(limits.force_min_g, limits.force_max_g)
            text = f"{limits.force_min_g:g} to {limits.force_max_g:g} g: [limits] in rig.toml"
            self.force.setToolTip(text)


class ImbalancePart(PartPage):
    """The load cell's error over a turn of the drum."""

    def __init__(self) -> None:
        super().__init__(IMBALANCE, "Turn and measure", "Measure the imbalance over one turn")
        self.plot, self.table = ImbalancePlot(), label("", "muted", wraps=True)
        show_text(self.task, IMBALANCE_TASK)
        self.lay_out(self.plot, self.table)

    def measure(self) -> None:
        """Turn once."""
        self.send("calibrate_imbalance")

    def result(self, found: CalibrationStatus) -> str:
        """Return half of the change over a turn."""
        return imbalance_words(found.imbalance_g) if found.imbalance_g else ""

    def show_status(self, status: EngineStatus) -> None:
        """Show the table, and what becomes of it."""
        super().show_status(status)
        table_g, saved = status.calibration.imbalance_g, status.calibration.saved
        self.plot.show_table(table_g)
        values = ", ".join(f"{value:+.2f}" for value in table_g).replace("-", "−")
        kept = "" if IMBALANCE in saved else f"; {KEPT}"
        show_text(self.table, f"From the index mark on, in g: {values}{kept}" if table_g else "")
