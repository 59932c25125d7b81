"""The page Calibrate: load cell, force loop, imbalance, order and ranges of the taxels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import (
    QHeaderView,
    QLayout,
    QPushButton,
    QSizePolicy,
    QTableWidget,
    QTableWidgetItem,
    QTabWidget,
    QWidget,
)

from gui.widgets.formatting import age, capitalised, grouped
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import (
    EventWatch,
    FlowLayout,
    focus_wheel,
    hbox,
    push_button,
    scroll_area,
    vbox,
)
from gui.widgets.number_box import NumberBox, has_refused
from gui.widgets.plot_axes import (
    BOTTOM_PX,
    LEFT_PX,
    PlotGrid,
    colour_axes,
    fixed_plot,
    reserve,
)
from gui.widgets.theme import Theme, applied_theme, scaled_px
from rigctl.config.rig_config import RigLimits
from rigctl.encoder.reading import Reading
from rigctl.engine.calibration_values import (
    FORCE,
    IMBALANCE,
    LEAST_RATIO,
    LOADCELL,
    RANGE,
    WIRING,
    CalibrationStatus,
    MassReading,
    TaxelRange,
    gains_words,
    imbalance_words,
    scale_words,
    wiring_words,
)
from rigctl.engine.load_cell_scale import MAX_SPREAD_SHARE, fit_line
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.engine.wiring_identification import (
    N_STEPS,
    PER_LAYER,
    SIDE,
    place_name,
    reading_name,
)

WIDTH_PX, LEAST_PX, HEIGHT_PX, POINT_PX = 300, 200, 140, 8


class Stem(NamedTuple):
    """An error: ``place`` from 0 at the left to 1 at the right, ``name`` below it."""

    place: float
    error_g: float
    name: str


class StemPlot(PlotGrid):
    """Draws stems; ``hint`` stands in place of them. ``title`` says what both axes are."""

    def __init__(self, title: str, hint: str) -> None:
        super().__init__(label(title, "muted", wraps=True))
        self.stems: list[Stem] = []
        self._hint = hint
        self.setAccessibleName(title)
        self.graphics.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._plot = fixed_plot(self.cells, 0, 0)
        reserve(self._plot, "left", LEFT_PX)
        reserve(self._plot, "bottom", BOTTOM_PX)
        self._plot.setXRange(-0.07, 1.07, padding=0)  # room for half a name at each end
        self._draw()
        EventWatch(self, self._draw, QEvent.Type.PaletteChange, QEvent.Type.FontChange)

    def sizeHint(self) -> QSize:
        """Return a size that suits a small window."""
        return QSize(scaled_px(WIDTH_PX), self.minimumSizeHint().height())

    def show_stems(self, stems: Sequence[Stem], unit: str = "") -> None:
        """Show errors; ``unit`` follows each name in words."""
        if list(stems) != self.stems:
            self.stems = list(stems)
            lines = [f"{stem.name}{unit}: {stem.error_g:+.2f} g" for stem in stems]
            self.setToolTip("\n".join(lines))
            self.setAccessibleDescription("; ".join(lines))
            self._draw()

    def _draw(self) -> None:
        theme, plot = applied_theme(), self._plot
        self.graphics.setMinimumWidth(scaled_px(LEAST_PX))
        self.graphics.setFixedHeight(scaled_px(HEIGHT_PX))
        self.graphics.setBackground(None)
        plot.getViewBox().setBorder(theme.line)
        colour_axes(plot, theme)
        plot.clear()
        most_g = 1.25 * max(0.1, *(abs(stem.error_g) for stem in self.stems), 0.0)
        plot.setYRange(-most_g, most_g, padding=0)
        values = [(value, f"{value:+.2f}".replace("-", "−")) for value in (most_g, -most_g)]
        plot.getAxis("left").setTicks([[*values, (0, "0")] if self.stems else [], []])
        plot.getAxis("bottom").setTicks([[(stem.place, stem.name) for stem in self.stems], []])
        if not self.stems:
            hint = pg.TextItem(self._hint, color=theme.muted, anchor=(0.5, 0.5))
            plot.addItem(hint)
            hint.setPos(0.5, 0)
            return
        x, y = np.array([(stem.place, stem.error_g) for stem in self.stems]).T
        zero = pg.mkPen(theme.muted, width=1, style=Qt.PenStyle.DashLine)
        plot.addItem(pg.InfiniteLine(0, angle=0, pen=zero))
        ends = np.column_stack((np.zeros(len(y)), y)).ravel()
        pen = pg.mkPen(theme.accent, width=1.5)
        plot.addItem(pg.PlotCurveItem(np.repeat(x, 2), ends, connect="pairs", pen=pen))
        plot.addItem(pg.ScatterPlotItem(x, y, size=POINT_PX, brush=theme.accent, pen=pen))


IMBALANCE_TITLE = "Error (g) over the sixteenth of the turn, from the index mark on"
IMBALANCE_HINT = "Turn the drum once to measure it"
RESIDUAL_TITLE = "Deviation from the line (g) at each mass (g)"
RESIDUAL_HINT = "Two readings make a line"
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
        if status.fault or not status.drum_connected:
            self._refusal = ""  # of before the fault, or of another connection
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
        self.setLayout(
            vbox(
                *(self.task, *rows, buttons, self.state, self.result_label),
                spacing=6,
                margins=(9, 6, 9, 6),
                tall=-1,
            )
        )

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


PRESS, FLAT = "Press", "Press all"
GAP_PX = 4


class SensorMap(QWidget):
    """Nine places, row 1 at the top. A place to press has a thick frame and the word “Press”.

    Known places have a check mark and the readings of their two taxels.
    """

    def __init__(self) -> None:
        super().__init__()
        self.asked: tuple[int, ...] = ()
        self.known: tuple[tuple[int, int], ...] = ()
        self.setAccessibleName("Map of the sensor")

    def minimumSizeHint(self) -> QSize:
        """Return the size that the names of the readings need."""
        return QSize(scaled_px(224), scaled_px(170))

    def sizeHint(self) -> QSize:
        """Return a size that suits a small window."""
        return QSize(scaled_px(340), scaled_px(190))

    def show_places(self, asked: Sequence[int], known: Sequence[tuple[int, int]]) -> None:
        """Show the places to press, and the two readings of each place that is known."""
        if (tuple(asked), tuple(known)) == (self.asked, self.known):
            return
        self.asked, self.known = tuple(asked), tuple(known)
        words = [f"{place_name(place)}: {self.text_of(place)}" for place in range(PER_LAYER)]
        self.setAccessibleDescription("; ".join(words).replace("\n", " "))
        self.update()

    def text_of(self, place: int) -> str:
        """Return what stands at a place."""
        if place in self.asked:
            return FLAT if len(self.asked) > 1 else PRESS
        if place < len(self.known):
            upper, lower = map(reading_name, self.known[place])
            return f"✓\n{upper}\n{lower}"
        return "?"

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the places."""
        painter, theme = QPainter(self), applied_theme()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        width, height = self.width() / SIDE, self.height() / SIDE
        for place in range(PER_LAYER):
            row, column = divmod(place, SIDE)
            cell = QRectF(column * width, row * height, width, height)
            self._draw(painter, place, cell.adjusted(GAP_PX, GAP_PX, -GAP_PX, -GAP_PX), theme)

    def _draw(self, painter: QPainter, place: int, cell: QRectF, theme: Theme) -> None:
        is_asked = place in self.asked
        painter.setPen(QPen(QColor(theme.accent if is_asked else theme.line), 4 if is_asked else 1))
        painter.setBrush(QColor(theme.plot))
        painter.drawRoundedRect(cell, 5, 5)
        font = painter.font()
        font.setBold(is_asked)
        painter.setFont(font)
        painter.setPen(QColor(theme.text if is_asked or place < len(self.known) else theme.muted))
        painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, self.text_of(place))


FLAT_STEP = 1
DONE_TIP = "Measure for one second, once you have done what is asked"
REPEAT_TIP = "Ask for the last place again"
LIFTS = " The drum lifts and switches off first: keep clear of it until it stands."
PRESSED_BY_ITSELF = " The simulated sensor is unplugged and pressed by itself."
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
        beside = vbox(label(LEGEND, "muted", wraps=True), self.found, spacing=8, tall=-1)
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
    by_itself = PRESSED_BY_ITSELF if status.simulated else ""
    step = f"Step {found.wiring_step + 1} of {N_STEPS}. "
    return f"{step}{found.wiring_question}{first}{by_itself}"


def _asked(found: CalibrationStatus) -> tuple[int, ...]:
    """Return the places to press now."""
    if found.wiring_place is not None:
        return (found.wiring_place,)
    is_flat = found.wiring_step == FLAT_STEP and not found.wiring
    return tuple(range(PER_LAYER)) if is_flat else ()


EMPTY = (
    "Take everything off the drum, keep clear of it, and let it come to rest. Then press Read: "
    "the drum lifts, switches off, and its load cell is read."
)
NEXT = "Lay a known mass on the drum, type its grams, and let it come to rest. Then press Read."
MORE = "Lay on another mass, type its grams and press Read, or save the scale."
LAID_BY_ITSELF = " The simulated rig lays the mass on and takes it off by itself."
COLUMNS = ("Mass (g)", "Counts", "± counts", "Error (g)")
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
        self.plot = StemPlot(RESIDUAL_TITLE, RESIDUAL_HINT)
        self.remove_button = push_button("Remove", self._remove, REMOVE_TIP)
        self._readings: tuple[MassReading, ...] = ()
        field = hbox(label("Mass"), self.mass, wide=-1, spacing=6)
        both = FlowLayout(self.table, self.plot)
        self._fit_texts()
        EventWatch(self, self._fit_texts, QEvent.Type.FontChange)
        self.lay_out(field, self.live, both, extra=(self.remove_button,))

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
        show_text(self.task, task + (LAID_BY_ITSELF if status.simulated and n_read else ""))
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
        widest_g = max(masses_g, default=0.0) or 1.0
        points = zip(masses_g, residuals, strict=False)  # no residual: no line
        self.plot.show_stems([Stem(g / widest_g, left_g, f"{g:g}") for g, left_g in points], " g")
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


FORCE_TASK = (
    "Mount a plate and keep clear of the drum. It lifts, tares, homes, presses with this force, "
    "makes a small step, lifts and switches off; its answer to the step gives the gains."
)
RANGE_TASK = (
    "Mount a plate with ridges and keep clear of the drum. It lifts and shows what each taxel "
    "reads untouched; then it tares, homes, presses with this force, turns over the plate once, "
    "lifts and switches off. The lowest and highest reading of each taxel become its range."
)
RANGE_COLUMNS = (
    "Taxel",
    "Lowest ({unit})",
    "Highest ({unit})",
    "Span ({unit})",
    "Untouched ({unit})",
)
RANGE_PX = 320
SAVE_RANGE_TIP = "Save the ranges in rig.toml, which a connection begins with"
MEASURE_AGAIN = (
    "Measure again after a change of sensor, skin or gain: in a range that is too narrow, noise "
    "fires"
)
READING_UNITS = {Reading.COUNTS: "counts", Reading.CONDUCTANCE: "steps"}
IMBALANCE_TASK = (
    "Take the plate off, or leave it on as in use, and keep clear of the drum. It lifts and turns "
    "once; the load cell's error in each sixteenth of the turn is taken out of later readings."
)
KEPT = "the board uses this table until it is switched off, and from then on only if it is saved"


class PressPart(PartPage):
    """The force of a press; ``command`` presses with it."""

    def __init__(self, part: str, command: str, texts: tuple[str, str], task: str) -> None:
        super().__init__(part, *texts)
        self._command = command
        self.force = focus_wheel(NumberBox(decimals=0, suffix=" g", singleStep=50))
        self.force.setAccessibleName(f"Force: {TITLES[part].lower()}")
        self._limits: RigLimits | None = None
        self._set_limits(RigLimits())
        self.force.setValue(500.0)
        self.field = hbox(label("Force"), self.force, wide=-1, spacing=6)
        show_text(self.task, task)

    def measure(self) -> None:
        """Press, measure and lift."""
        if not has_refused(self.force):
            self.send(self._command, force_g=self.force.value())

    def show_status(self, status: EngineStatus) -> None:
        """Show what was found; the force has the limits of the rig."""
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


class ForcePart(PressPart):
    """The gains that were found."""

    def __init__(self) -> None:
        texts = ("Press and measure", "Find the gains of the force loop")
        super().__init__(FORCE, "calibrate_force", texts, FORCE_TASK)
        self.lay_out(self.field)

    def result(self, found: CalibrationStatus) -> str:
        """Return the gains."""
        return gains_words(found.gains) if found.gains is not None else ""


class RangePart(PressPart):
    """Lowest and highest reading of each taxel in a press over the plate."""

    def __init__(self) -> None:
        texts = ("Press, turn and measure", "Measure the range to which traces and spikes scale")
        super().__init__(RANGE, "calibrate_range", texts, RANGE_TASK)
        self.table = QTableWidget(0, len(RANGE_COLUMNS))
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self.table.setAccessibleName("Range of each taxel")
        rows = self.table.verticalHeader()
        rows.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.setMinimumHeight(scaled_px(RANGE_PX))
        self._shown: TaxelRange | None = None
        self.lay_out(self.field, self.table)
        self.save_button.setToolTip(SAVE_RANGE_TIP)
        self.discard_button.hide()

    def result(self, found: CalibrationStatus) -> str:
        """Return the narrowest range, or which taxels moved too little."""
        ranges = found.taxel_range
        if ranges is None:
            return ""
        if ranges.problem:
            return capitalised(ranges.problem)
        spans = np.subtract(ranges.high, ranges.low)
        least = int(spans.argmin())
        until = "" if RANGE in found.saved else " until the rig disconnects"
        return (
            f"In use{until}: {len(spans)} ranges, the narrowest that of "
            f"T{least + 1} with {spans[least]}"
        )

    def has_readings(self, found: CalibrationStatus) -> bool:
        """Return whether there are ranges that can be saved."""
        return found.taxel_range is not None and not found.taxel_range.problem

    def show_status(self, status: EngineStatus) -> None:
        """Show the ranges, marked where they are too narrow."""
        super().show_status(status)
        ranges = status.calibration.taxel_range
        is_bad = ranges is not None and bool(ranges.problem)
        set_property(self.result_label, "role", "bad" if is_bad else "heading")
        if is_bad or not status.calibration.rig_file:
            self.save_button.setEnabled(False)
        if self.has_readings(status.calibration) and not status.calibration.rig_file:
            show_text(self.result_label, f"{self.result(status.calibration)}; {REHEARSED}")
        if ranges is None and status.range_from:
            show_text(self.result_label, f"In use: rig.toml, {status.range_from}. {MEASURE_AGAIN}")
        self.table.setVisible(ranges is not None)
        if ranges is not None and ranges != self._shown:
            self._shown = ranges
            self._show_ranges(ranges, READING_UNITS[status.reading])

    def _show_ranges(self, ranges: TaxelRange, unit: str) -> None:
        titles = [title.format(unit=unit) for title in RANGE_COLUMNS]
        self.table.setHorizontalHeaderLabels(titles)
        self.table.setRowCount(len(ranges.low))
        for row, (low, high, rest) in enumerate(zip(*ranges, strict=True)):
            sign = "✓" if high - low >= LEAST_RATIO * max(rest, 1) else "✗"
            for column, text in enumerate((f"{sign} T{row + 1}", low, high, high - low, rest)):
                item = QTableWidgetItem(str(text))
                item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                self.table.setItem(row, column, item)


class ImbalancePart(PartPage):
    """The load cell's error over a turn of the drum."""

    def __init__(self) -> None:
        super().__init__(IMBALANCE, "Turn and measure", "Measure the imbalance over one turn")
        self.plot = StemPlot(IMBALANCE_TITLE, IMBALANCE_HINT)
        self.table = label("", "muted", wraps=True)
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
        last = max(1, len(table_g) - 1)
        self.plot.show_stems([Stem(n / last, g, f"{n + 1}") for n, g in enumerate(table_g)])
        values = ", ".join(f"{value:+.2f}" for value in table_g).replace("-", "−")
        kept = "" if IMBALANCE in saved else f"; {KEPT}"
        show_text(self.table, f"From the index mark on, in g: {values}{kept}" if table_g else "")


COMMANDS = {
    "calibrate_loadcell": LOADCELL,
    "forget_mass": LOADCELL,
    "calibrate_force": FORCE,
    "calibrate_range": RANGE,
    "calibrate_imbalance": IMBALANCE,
    "calibrate_wiring": WIRING,
    "repeat_press": WIRING,
}
"""The part to which each command of the engine belongs."""
TITLES = {
    LOADCELL: "Load cell",
    FORCE: "Force loop",
    IMBALANCE: "Imbalance",
    WIRING: "Taxel order",
    RANGE: "Range",
}


class CalibratePage(QWidget):
    """A tab for each part; it shows what the engine has measured, whoever asked for it."""

    command_requested = Signal(str, dict)
    closed = Signal()
    """The user wants to see the page from before."""

    def __init__(self) -> None:
        super().__init__()
        self.load_cell, self.force = LoadCellPart(), ForcePart()
        self.imbalance, self.wiring = ImbalancePart(), WiringPart()
        self.taxel_range = RangePart()
        parts = (self.load_cell, self.force, self.imbalance, self.wiring, self.taxel_range)
        self.parts: dict[str, PartPage] = {part.part: part for part in parts}
        self._asked: dict[str, str] = {}
        """The part that each command was last about, where it has one as argument."""
        self.tabs = QTabWidget()
        for part in parts:
            self.tabs.addTab(scroll_area(part), TITLES[part.part])
            part.command_requested.connect(self._request)
        self.close_button = push_button("Close", self.closed.emit)
        heading = hbox(label("Calibrate", "heading"), self.close_button, spacing=8)
        self.setLayout(vbox(heading, self.tabs, spacing=4, margins=(9, 4, 9, 4), tall=1))
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
