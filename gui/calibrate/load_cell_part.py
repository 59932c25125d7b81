"""The load cell: known masses one after another, and the scale that fits them."""

from __future__ import annotations

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QHeaderView, QTableWidget, QTableWidgetItem

from gui.calibrate.part_page import PartPage
from gui.calibrate.residual_plot import ResidualPlot
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.focus_wheel import focus_wheel
from gui.widgets.formatting import age, grouped
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import hbox, push_button
from gui.widgets.number_box import NumberBox, has_refused
from gui.widgets.theme import scaled_px
from rigctl.acquisition.calibration.calibration_values import (
    LOADCELL,
    CalibrationStatus,
    MassReading,
)
from rigctl.acquisition.calibration.load_cell_scale import MAX_SPREAD_SHARE, fit_line
from rigctl.acquisition.calibration.words import scale_words
from rigctl.acquisition.rpc.messages import EngineStatus

EMPTY = (
    "Take everything off the drum, keep clear of it, and let it come to rest. Then press Read: "
    "the drum lifts, switches off, and its load cell is read."
)
NEXT = "Lay a known mass on the drum, type its grams, and let it come to rest. Then press Read."
MORE = "Lay on another mass, type its grams and press Read, or save the scale."
BY_ITSELF = " The simulated rig lays the mass on and takes it off by itself."
COLUMNS = ("Mass (g)", "Counts", "± counts", "Off line (g)")
READ_TIP = "Read the load cell with this mass for two seconds"
REMOVE_TIP = "Remove the reading of the chosen row"
OLD_S = 0.5
COLUMN_PX = 80
MAX_MASS_G = 100_000.0


class LoadCellPart(PartPage):
    """Mass, live reading, table of readings, and a plot of what the line leaves."""

    def __init__(self) -> None:
        super().__init__(LOADCELL, "Read", READ_TIP)
        self.mass = focus_wheel(NumberBox(decimals=1, suffix=" g"))
        self.mass.setRange(0.0, MAX_MASS_G)
        self.mass.setValue(200.0)
        self.mass.setAccessibleName("Known mass")
        self.live = label("", "muted", wraps=True)
        self.table = QTableWidget(0, len(COLUMNS))
        self.table.setHorizontalHeaderLabels(list(COLUMNS))
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.setSelectionBehavior(QTableWidget.SelectionBehavior.SelectRows)
        self.table.setSelectionMode(QTableWidget.SelectionMode.SingleSelection)
        self.table.setMinimumHeight(110)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self.table.setAccessibleName("Readings with known masses")
        self.plot = ResidualPlot()
        self.remove_button = push_button("Remove", self._remove, REMOVE_TIP)
        self._readings: tuple[MassReading, ...] = ()
        field = hbox(label("Mass"), self.mass, wide=-1, spacing=6)
        field.addStretch(1)
        both = FlowLayout(self.table, self.plot)
        self._fit_texts()
        self.lay_out(field, self.live, both, extra=(self.remove_button,))

    def changeEvent(self, event: QEvent) -> None:
        """Keep the numbers whole when the texts become larger."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange and hasattr(self, "plot"):
            self._fit_texts()

    def _fit_texts(self) -> None:
        self.table.horizontalHeader().setMinimumSectionSize(scaled_px(COLUMN_PX))
        self.table.setMinimumWidth(scaled_px(COLUMN_PX * len(COLUMNS) + 20))

    def measure(self) -> None:
        """Read the load cell, first without a mass."""
        if not self._readings:
            self.send("calibrate_loadcell", mass_g=0.0)
        elif not has_refused(self.mass):
            self.send("calibrate_loadcell", mass_g=self.mass.value())

    def result(self, found: CalibrationStatus) -> str:
        """Return the scale."""
        if found.scale_ug_per_count is None:
            return ""
        return scale_words(found.scale_ug_per_count, found.nonlinearity_share or 0.0)

    def has_readings(self, found: CalibrationStatus) -> bool:
        """Return whether a mass was read."""
        return bool(found.masses)

    def show_status(self, status: EngineStatus) -> None:
        """Show the readings, the live one, and what to do next."""
        super().show_status(status)
        found = status.calibration
        n_read = len(found.masses)
        task = (EMPTY, NEXT, MORE)[min(n_read, 2)]
        show_text(self.task, task + (BY_ITSELF if status.simulated and n_read else ""))
        self.mass.setEnabled(n_read > 0 and self.measure_button.isEnabled())
        self._show_live(status)
        if found.masses != self._readings:
            self._readings = found.masses
            self._show_readings()
        chosen = self.table.selectionModel().hasSelection()
        self.remove_button.setEnabled(self.discard_button.isEnabled() and chosen)
        if found.scale_problem:
            show_text(self.result_label, found.scale_problem)
        set_property(self.result_label, "role", "bad" if found.scale_problem else "heading")

    def show_old(self, seconds: float) -> None:
        """Say that the reading is no longer live."""
        show_text(self.live, f"The load cell's last reading is {age(seconds)} old")

    def _show_live(self, status: EngineStatus) -> None:
        counts, spread = status.loadcell_counts, status.loadcell_sd_counts
        age_s = status.loadcell_age_s or 0.0
        if counts is None or spread is None or not status.scale_ug_per_count:
            show_text(self.live, "No reading of the load cell yet")
        elif age_s > OLD_S:
            self.show_old(age_s)
        else:
            self._show_reading(status, counts, spread)

    def _show_reading(self, status: EngineStatus, counts: float, spread: float) -> None:
        force = f"{status.force_g:.1f} g, " if status.tared else ""
        text = f"Now {force}{grouped(counts)} counts ± {grouped(spread)} in the last second"
        if largest_g := max(self.mass.value(), *(r.mass_g for r in self._readings), 0.0):
            allowed = MAX_SPREAD_SHARE * largest_g * 1e6 / abs(status.scale_ug_per_count)
            rest = "at rest" if spread <= allowed else "not at rest"
            text = f"{text}: {rest} (at most ± {grouped(allowed)} for {largest_g:g} g)"
        show_text(self.live, text)

    def _show_readings(self) -> None:
        masses_g = [reading.mass_g for reading in self._readings]
        differ = len({reading.mean_counts for reading in self._readings}) > 1
        residuals = fit_line(self._readings).residuals_g if differ else ()
        self.plot.show_points(masses_g if residuals else [], residuals)
        self.table.setRowCount(len(self._readings))
        for row, reading in enumerate(self._readings):
            left = f"{residuals[row]:+.2f}".replace("-", "−") if residuals else "–"
            texts = (f"{reading.mass_g:g}", grouped(reading.mean_counts))
            for column, text in enumerate((*texts, grouped(reading.sd_counts), left)):
                item = QTableWidgetItem(text)
                item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                self.table.setItem(row, column, item)

    def _remove(self) -> None:
        rows = self.table.selectionModel().selectedRows()
        if rows:
            self.send("forget_mass", mass_g=self._readings[rows[0].row()].mass_g)
