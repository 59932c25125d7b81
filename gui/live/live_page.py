"""The page of the live plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import partial
from typing import Any

from PySide6.QtCore import QElapsedTimer, QObject, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QPushButton, QScrollBar, QWidget

from gui.analysis.export import Content, FileSaver, foot_text, image_with_foot, in_process
from gui.live.earlier_trials import BIN_S, MOST, TrialSpan, TrialStarts, condition_of
from gui.live.encoder_strip import EncoderStrip
from gui.live.eye_filter import EyeFilter
from gui.live.live_data import NOMINAL_SUPPLY_V, ValueScale
from gui.live.live_plots import LEAST_GAIN, MOST_GAIN, LivePlots
from gui.live.navigation import SPANS_S, Navigation
from gui.live.pointer import Pointer, cursor_text, difference_text
from gui.live.raster import FULL_SCALE_HZ
from gui.live.saver import SaveStrip, shown_samples, write_table
from gui.live.spike_sound import SoundStrip, SpikeSound
from gui.widgets.background import Background
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import ComboBox, FlowLayout, container, hbox, push_button, vbox
from gui.widgets.number_box import NumberBox, WholeNumberBox
from gui.widgets.theme import Theme
from rigctl.encoder.reading import FULL_SCALE, Reading, input_of_each
from rigctl.engine.live_file import LiveReader
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import SensorLayout

OFF = "The time axis scrolls with the newest samples."
WAITS = "No trial has begun yet: the time axis scrolls until the sync line rises."


class AlignmentStrip(QWidget):
    """``align``: the mode's switch; ``count``: the number of earlier trials."""

    changed = Signal()
    """Another mode or number."""

    def __init__(self) -> None:
        super().__init__()
        self.align = QCheckBox("begin each trial at the left")
        self.align.setToolTip("t = 0 is the first sample of the trial, as the session cuts it")
        self.count = WholeNumberBox(minimum=0, maximum=MOST, value=5)
        self.count.setToolTip(
            "Whole trials of the same plate, speed and force, in faint lines: force, speed, the\n"
            "readings of the chosen taxel, and in its rows of the raster the mean rate of its\n"
            f"neurons in bins of {1000 * BIN_S:.0f} ms"
        )
        self.count.setAccessibleName("Earlier trials behind the present one")
        self.sentence = ElidedLabel(OFF, "muted")
        row = FlowLayout(self.align, label("earlier trials"), self.count)
        self.setLayout(vbox(row, self.sentence, spacing=2, margins=(6, 0, 6, 0)))
        self.align.toggled.connect(lambda _: self.changed.emit())
        self.count.valueChanged.connect(lambda _: self.changed.emit())

    def show_state(self, condition: str | None, n_earlier: int, taxel: int) -> None:
        """Say what is shown: the condition of the present trial, None before the first one."""
        show_text(self.sentence, self._words(condition, n_earlier, taxel))

    def _words(self, condition: str | None, n_earlier: int, taxel: int) -> str:
        if not self.align.isChecked():
            return OFF
        if condition is None:
            return WAITS
        words = f"{condition}; faint: {n_earlier} earlier"
        if not n_earlier:
            return words
        rate = f"mean rate, 0–{FULL_SCALE_HZ:.0f} Hz"
        return f"{words}; line in the raster rows of T{taxel + 1}: {rate}"


class TrialAlignment(QObject):
    """Finds trials in the samples as they come, and aligns the plots if the strip says so."""

    def __init__(self, plots: LivePlots, strip: AlignmentStrip) -> None:
        super().__init__(plots)
        self._plots, self._strip = plots, strip
        self.starts = TrialStarts()
        self.taxel = 0
        strip.changed.connect(self._apply)

    def show_status(self, status: EngineStatus) -> None:
        """Take the condition of the trial that begins next."""
        self.starts.condition = condition_of(status)

    def show_taxel(self, taxel: int) -> None:
        """Show earlier readings and rates of another taxel, from 0."""
        self.taxel = taxel
        self._apply()

    def follow(self) -> None:
        """Take new samples; begin anew at the left where a trial began."""
        history, navigation = self._plots.data.history, self._plots.navigation
        self.starts.follow(history)
        if not self._strip.align.isChecked() or navigation.is_paused:
            return
        trial = self._present()
        if navigation.trial_start != (None if trial is None else trial.start):
            self._align(trial)

    def _present(self) -> TrialSpan | None:
        return self.starts.newest(self._plots.data.history.oldest)

    def _apply(self) -> None:
        if not self._strip.align.isChecked():
            self._align(None)
        elif not self._plots.navigation.is_paused or self._plots.navigation.trial_start is None:
            self._align(self._present())
        else:
            self._align(self._shown())
        self._plots.draw()

    def _shown(self) -> TrialSpan | None:
        """Return the trial that a look back shows."""
        start = self._plots.navigation.trial_start
        return next((trial for trial in self.starts.trials if trial.start == start), None)

    def _align(self, trial: TrialSpan | None) -> None:
        plots = self._plots
        oldest, count = plots.data.history.oldest, self._strip.count.value()
        earlier = [] if trial is None else self.starts.before(trial, count, oldest)
        plots.navigation.align_to(None if trial is None else trial.start)
        plots.show_earlier(earlier, self.taxel)
        condition = None if trial is None else str(trial.condition)
        self._strip.show_state(condition, len(earlier), self.taxel)


_COLUMNS = 9
_BUTTON_PX = 44


class TaxelStrip(QWidget):
    """Toggle buttons in rows of nine that begin anew with each layer; beside them one for it."""

    chosen = Signal(tuple)
    """The taxels to show, from 0; never empty."""

    def __init__(self, layout: SensorLayout) -> None:
        super().__init__()
        self._grid = QGridLayout()
        self._grid.setSpacing(3)
        self._grid.setContentsMargins(6, 0, 6, 0)
        self.setLayout(hbox(container(self._grid), label(), wide=1))
        self.buttons: list[QPushButton] = []
        self.groups: list[QPushButton] = []
        self.set_sensor_layout(layout)

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Offer the taxels of another sensor."""
        for button in (*self.buttons, *self.groups):
            self._grid.removeWidget(button)
            button.deleteLater()
        self.buttons = [self._taxel_button(taxel) for taxel in range(layout.n_taxels)]
        every = tuple(range(layout.n_taxels))
        self.groups = [push_button("All", partial(self._choose, every))]
        has_layers, row = len(layout.layers) > 1, 0
        for layer, name in enumerate(layout.layers):
            taxels = tuple(layout.taxels_of(layer))
            for place, taxel in enumerate(taxels):
                place_row, column = divmod(place, _COLUMNS)
                self._grid.addWidget(self.buttons[taxel], row + place_row, column)
            if has_layers:
                self.groups.append(push_button(f"Layer {name}", partial(self._choose, taxels)))
                self._grid.addWidget(self.groups[-1], row, _COLUMNS)
            row += -(-len(taxels) // _COLUMNS)
        self._grid.addWidget(self.groups[0], 0, _COLUMNS + has_layers)
        self.show_chosen(every)

    def show_chosen(self, taxels: tuple[int, ...]) -> None:
        """Press the buttons of these taxels."""
        for taxel, button in enumerate(self.buttons):
            button.setChecked(taxel in taxels)

    def _taxel_button(self, taxel: int) -> QPushButton:
        button = push_button(f"T{taxel + 1}", self._emit, f"Show taxel {taxel + 1}")
        button.setCheckable(True)
        button.setFixedWidth(_BUTTON_PX)
        return button

    def _choose(self, taxels: tuple[int, ...]) -> None:
        self.show_chosen(taxels)
        self._emit()

    def _emit(self) -> None:
        taxels = tuple(i for i, button in enumerate(self.buttons) if button.isChecked())
        if taxels:
            self.chosen.emit(taxels)


HIGH_PASSES_HZ = (0.0, 0.5, 1.0, 5.0, 10.0, 50.0, 100.0)
LOW_PASSES_HZ = (0.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
EYE_ALONE = "For the eye alone: record, spikes, maps and tables have the readings as they are"


class EyeStrip(QWidget):
    """Gain and filters of the traces; loading SciPy for the first filter takes its own thread."""

    failed = Signal(str)

    def __init__(self, plots: LivePlots) -> None:
        super().__init__()
        self._plots, self._background = plots, Background("rigctl-filter")
        self.gain = NumberBox(minimum=LEAST_GAIN, maximum=MOST_GAIN, value=1.0, decimals=2)
        self.gain.setPrefix("× ")
        self.gain.setToolTip("How high the traces are drawn (Ctrl and the wheel over the plots)")
        self.high_pass = self._edges("High-pass of the traces", HIGH_PASSES_HZ)
        self.low_pass = self._edges("Low-pass of the traces", LOW_PASSES_HZ)
        filters = (label("High-pass"), self.high_pass, label("Low-pass"), self.low_pass)
        row, sentence = FlowLayout(label("Gain"), self.gain, *filters), ElidedLabel(EYE_ALONE)
        self.setLayout(vbox(row, sentence, spacing=2, margins=(6, 0, 6, 0)))
        self.gain.valueChanged.connect(plots.set_gain)
        plots.gain_changed.connect(self._show_gain)

    def apply(self) -> None:
        """Filter the readings that are shown, or none."""
        high_hz, low_hz = self.high_pass.currentData(), self.low_pass.currentData()
        if high_hz or low_hz:
            make = partial(EyeFilter, high_hz, low_hz, self._plots.data.reading)
            self._background.run(make, self._take, self.failed.emit)
        else:
            self._plots.set_eye_filter(None)

    def close_files(self) -> None:
        """Wait for the thread, as before the window closes."""
        self._background.close()

    def _take(self, eye: EyeFilter) -> None:
        """Show a filter unless another one was chosen meanwhile."""
        if (eye.high_hz, eye.low_hz) == (self.high_pass.currentData(), self.low_pass.currentData()):
            self._plots.set_eye_filter(eye)

    def _show_gain(self, gain: float) -> None:
        # Return emits an unchanged value, too; showing it would hide a text that was refused.
        if gain != self.gain.value():
            with QSignalBlocker(self.gain):
                self.gain.setValue(gain)

    def _edges(self, name: str, edges_hz: Sequence[float]) -> ComboBox:
        box = ComboBox()
        for hz in edges_hz:
            box.addItem(f"{hz:g} Hz" if hz else "off", hz)
        box.setToolTip(f"{name}. {EYE_ALONE}")
        box.setAccessibleName(name)
        box.currentIndexChanged.connect(lambda _: self.apply())
        return box


COUNTS, VOLTS, CONDUCTANCE = "counts", "volts", "conductance"
_STEP = 10  # samples in one step of the scroll bar, whose numbers have 32 bits


class LiveBar(QWidget):
    """Controls of a navigation; ``strips``: names of buttons that show a strip each."""

    strip_toggled = Signal(str, bool)
    """The name of a strip's button, and whether the strip is to be shown."""

    def __init__(self, navigation: Navigation, strips: dict[str, str]) -> None:
        super().__init__()
        self._navigation = navigation
        self.pause = push_button(
            "Pause", navigation.toggle, "Look back while samples go on (Space)"
        )
        self.span = ComboBox()
        for span_s in SPANS_S:
            self.span.addItem(f"{span_s} s", span_s)
        self.span.setToolTip("Length of the time axis (+ and −)")
        self.unit = ComboBox()
        self.unit.addItems([COUNTS, VOLTS, CONDUCTANCE])
        self.unit.setToolTip(
            "Unit of the readings. Conductance is free of the load of the other taxels of an\n"
            "input, in multiples of the divider's; the encoder of the strip takes it, too"
        )
        self.buttons = {name: self._strip_button(name, tip) for name, tip in strips.items()}
        self.scroll_bar = QScrollBar(Qt.Orientation.Horizontal)
        self.scroll_bar.setAccessibleName("Place in the last minutes")
        self.place = label("live", "muted")
        self.place.setMinimumWidth(self.place.fontMetrics().horizontalAdvance("10 min 00 s ago"))
        first = FlowLayout(self.pause, self.span, self.unit, *self.buttons.values())
        self.setLayout(vbox(first, hbox(self.scroll_bar, self.place), spacing=3))
        self.span.activated.connect(lambda _: navigation.set_span(self.span.currentData()))
        self.scroll_bar.valueChanged.connect(self._move)
        navigation.changed.connect(self.show_place)
        self.show_place()

    def show_place(self) -> None:
        """Show where the views look."""
        navigation = self._navigation
        window, is_paused = navigation.window, navigation.is_paused
        self.pause.setText("Live" if is_paused else "Pause")
        with QSignalBlocker(self.scroll_bar):
            room = max(navigation.newest - window.span - navigation.oldest, 0)
            self.scroll_bar.setRange(0, room // _STEP)
            self.scroll_bar.setPageStep(max(1, window.span // _STEP))
            self.scroll_bar.setSingleStep(max(1, window.span // _STEP // 10))
            self.scroll_bar.setValue((window.left - navigation.oldest) // _STEP)
        behind_s = (navigation.newest - window.right) / 1000
        minutes, seconds = divmod(round(behind_s), 60)
        age = f"{minutes} min {seconds:02d} s ago" if minutes else f"{seconds} s ago"
        self.place.setText(age if is_paused else "live")
        if (index := self.span.findData(navigation.span_s)) >= 0:
            self.span.setCurrentIndex(index)

    def close_strips(self, except_for: str = "") -> None:
        """Release the buttons of all strips but one."""
        for name, button in self.buttons.items():
            if name != except_for and button.isChecked():
                button.setChecked(False)

    def _strip_button(self, name: str, tip: str) -> QPushButton:
        button = QPushButton(name)
        button.setCheckable(True)
        button.setToolTip(tip)
        button.toggled.connect(lambda is_on: self.strip_toggled.emit(name, is_on))
        return button

    def _move(self, value: int) -> None:
        navigation = self._navigation
        navigation.pause()
        navigation.move_to(navigation.oldest + value * _STEP + navigation.window.span)
        navigation.changed.emit()


TAXELS, TRIALS, ENCODER, VIEW = "Taxels", "Trials", "Encoder", "View"
LISTEN, SAVE = "Listen", "Save"
_STRIPS = {
    TAXELS: "Choose the taxels to show",
    TRIALS: "Begin each trial at the left edge, with earlier ones behind it",
    ENCODER: "Show the spikes of another encoder from now on",
    VIEW: "Draw the traces higher or filtered, for the eye alone",
    LISTEN: "Hear the spikes of a neuron as clicks",
    SAVE: "Save what is on the screen as a picture or a table",
}
LOOK_MS = 4
"""Period in which the page looks for new samples, which costs microseconds."""
_DRAW_MS = 10
"""Between two redraws, so that a board with small blocks does not fill the processor."""
_SILENT_MS = 60
"""Without samples for so long, force and speed are drawn alone."""
_TEXT_MS = 100


class LivePage(QWidget):
    """Controls, plots and readings at the cursor; it takes samples also while it is hidden."""

    reported = Signal(str, str)
    """Kind and text for the event log."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.plots = LivePlots(theme)
        self.pointer = Pointer(self.plots)
        self.bar = LiveBar(self.plots.navigation, _STRIPS)
        self.taxel_strip = TaxelStrip(self.plots.sensor_layout)
        self.eye_strip = EyeStrip(self.plots)
        self.sound = SpikeSound()
        self.sound_strip = SoundStrip(self.sound)
        self.encoder_strip, self.save_strip = EncoderStrip(self.plots.data), SaveStrip()
        self.alignment_strip = AlignmentStrip()
        self.alignment = TrialAlignment(self.plots, self.alignment_strip)
        self.files = FileSaver()
        self.cursor_label, self.difference_label = ElidedLabel(), ElidedLabel()
        self._strips: dict[str, QWidget] = {
            TAXELS: self.taxel_strip,
            TRIALS: self.alignment_strip,
            ENCODER: self.encoder_strip,
            VIEW: self.eye_strip,
            LISTEN: self.sound_strip,
            SAVE: self.save_strip,
        }
        self._supply_v, self._is_simulated = NOMINAL_SUPPLY_V, False
        self._engine_reading = Reading.COUNTS
        self._wiring: tuple[int, ...] | None = None
        self._taxel_inputs, self._full_scale = 1, FULL_SCALE
        self._live: LiveReader | None = None
        self._head = 0
        self._since_draw, self._since_texts = QElapsedTimer(), QElapsedTimer()
        self._since_samples = QElapsedTimer()
        self.timer = QTimer(self)
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(self._look)
        texts = vbox(self.cursor_label, self.difference_label, margins=(6, 0, 6, 0))
        self.setLayout(
            vbox(
                self.bar,
                *self._strips.values(),
                self.plots,
                texts,
                spacing=3,
                tall=1 + len(self._strips),
            )
        )
        for strip in self._strips.values():
            strip.hide()
        self._connect()
        self.show_texts()

    def follow(self, live: LiveReader | None) -> None:
        """Draw samples as soon as they come, from now on; None ends it."""
        self._live = live
        if live is None:
            self.timer.stop()
        else:
            self.timer.start(LOOK_MS)

    def refresh(self, live: LiveReader) -> None:
        """Take new samples; draw them if the page is shown and follows them."""
        if live.taxel_head != self._head:
            self._since_samples.start()
        self._head = live.taxel_head
        self.plots.pull(live)
        self.sound.follow(self.plots.data.history, self.plots.data.history.newest)
        self.alignment.follow()
        self.encoder_strip.set_ranges(self.plots.data.low, self.plots.data.high)
        if not self.isVisible():
            return
        self.plots.draw_new()
        self._since_draw.start()
        if not self._since_texts.isValid() or self._since_texts.hasExpired(_TEXT_MS):
            self._since_texts.start()
            self.show_texts()
            self.bar.show_place()

    def refresh_slowly(self, live: LiveReader) -> None:
        """Take and draw what came without new samples, such as force without a taxel board."""
        is_new = live.taxel_head != self._head
        is_silent = not self._since_samples.isValid() or self._since_samples.hasExpired(_SILENT_MS)
        if not self.isVisible() or (is_silent and not is_new):
            self.refresh(live)

    def _look(self) -> None:
        live = self._live
        if live is None or live.taxel_head == self._head or not self.isVisible():
            return
        if not self._since_draw.isValid() or self._since_draw.hasExpired(_DRAW_MS):
            self.refresh(live)

    def show_status(self, status: EngineStatus) -> None:
        """Take the sensor's layout, the supply of its board, and whether the rig is simulated."""
        if status.rig:  # plots of before stay while no rig is connected
            self._is_simulated = status.simulated
        layout = status.sensor_layout
        if layout != self.plots.sensor_layout:
            self.plots.set_sensor_layout(layout)
            self.taxel_strip.set_sensor_layout(layout)
        self.encoder_strip.show_status(status)
        self.alignment.show_status(status)
        board = status.boards.get("taxels")
        supply_v = board.supply_v if board is not None else None
        self._supply_v = supply_v or NOMINAL_SUPPLY_V
        if status.rig:
            self._wiring, self._taxel_inputs = status.wiring, status.taxel_inputs
            if status.full_scale != self._full_scale:
                self._full_scale = status.full_scale
                self._set_unit()
            if status.reading is not self._engine_reading:
                self._engine_reading = status.reading
                self.bar.unit.setCurrentText(status.reading)
        self._set_unit()

    def add_event(self, at_s: float, kind: str, text: str, data: Mapping[str, Any]) -> None:
        """Mark an event at its engine time."""
        self.plots.data.add_event(at_s, kind, text, data)

    def toggle_alignment(self) -> None:
        """Begin each trial at the left, or scroll again."""
        self.alignment_strip.align.toggle()

    def save_picture(self) -> None:
        """Save the plots as they are now into the folder of the strip Save."""
        now = f"{datetime.now():%Y-%m-%d %H:%M:%S}"
        foot = foot_text("live views", now, simulated=self._is_simulated)
        self._save("png", image_with_foot(self.plots.grab().toImage(), foot))

    def close_files(self) -> None:
        """Wait until all files are written and read, as before the window closes."""
        self.files.close()
        self.encoder_strip.close_files()
        self.eye_strip.close_files()
        self.sound.close_files()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)

    def show_texts(self) -> None:
        """Show the values at the cursor."""
        plots, taxel = self.plots, self.pointer.taxel
        window, scale = plots.navigation.window, plots.value_scale
        position = plots.cursors.position(window)
        reference = plots.cursors.reference
        texts = (
            cursor_text(plots.data, window, position, taxel, scale),
            difference_text(plots.data, position, reference, taxel, scale),
        )
        for widget, text in zip((self.cursor_label, self.difference_label), texts, strict=True):
            show_text(widget, text)

    def _connect(self) -> None:
        self.bar.strip_toggled.connect(self._show_strip)
        self.bar.unit.currentTextChanged.connect(lambda _: self._set_unit())
        self.encoder_strip.changed.connect(self._mark_encoder)
        for failed in (self.eye_strip.failed, self.sound.failed):
            failed.connect(lambda text: self.reported.emit("refused", text))
        self.encoder_strip.per_mm_toggled.connect(self.plots.set_rates_per_mm)
        self.save_strip.picture_requested.connect(self.save_picture)
        self.save_strip.table_requested.connect(self._save_table)
        self.files.saved.connect(lambda path: self.reported.emit("saved", f"saved {path}"))
        self.files.failed.connect(lambda sentence: self.reported.emit("refused", sentence))
        self.taxel_strip.chosen.connect(self.plots.show_taxels)
        self.pointer.enlarge_requested.connect(self._enlarge)
        self.pointer.taxel_changed.connect(lambda _: self.show_texts())
        self.pointer.taxel_changed.connect(self.alignment.show_taxel)
        self.pointer.taxel_changed.connect(self.sound.show_taxel)
        self.plots.lines_changed.connect(self.show_texts)
        self.plots.navigation.changed.connect(self.show_texts)

    def _show_strip(self, name: str, is_shown: bool) -> None:
        if is_shown:
            self.bar.close_strips(except_for=name)
        self._strips[name].setVisible(is_shown)

    def _set_unit(self) -> None:
        unit = self.bar.unit.currentText()
        reading = Reading.CONDUCTANCE if unit == CONDUCTANCE else Reading.COUNTS
        if self._wiring is None:  # no rig has been connected: what the window remembers waits
            reading = Reading.COUNTS
        before, inputs = self.plots.data.reading, tuple[int, ...]()
        try:
            if reading is Reading.CONDUCTANCE:
                inputs = input_of_each(self._wiring or (), self._taxel_inputs, "this rig")
        except WrongUse as error:
            self.reported.emit("refused", str(error))
            self.bar.unit.setCurrentText(Reading.COUNTS)
            return
        self.plots.data.show_reading(reading, self._engine_reading, inputs)
        if reading is not before:
            self.encoder_strip.apply_reading()
            self.eye_strip.apply()
        supply_v = self._supply_v if unit == VOLTS else None
        is_conductance = reading is Reading.CONDUCTANCE
        self.plots.set_value_scale(ValueScale(supply_v, is_conductance, self._full_scale))
        self.show_texts()

    def _mark_encoder(self, text: str) -> None:
        self.add_event(self.plots.data.history.newest_s, "encoder", text, {})
        self.plots.draw()

    def _save(self, suffix: str, content: Content) -> None:
        stem = f"live-{datetime.now():%Y-%m-%d-%H%M%S}"
        self.files.save(self.save_strip.folder.text(), stem, suffix, content)

    def _save_table(self) -> None:
        plots = self.plots
        window, taxels = plots.navigation.window, plots.time_plots.taxels
        scale, simulated = plots.value_scale, self._is_simulated
        shown = shown_samples(plots.data, window, taxels, scale, simulated=simulated)
        if len(shown.position):
            self._save("csv", in_process(write_table, shown))
        else:
            self.reported.emit("refused", "no table was saved: there are no samples in view yet")

    def _enlarge(self, taxel: int) -> None:
        """Show one taxel alone, or all again."""
        self.pointer.taxel = taxel
        self.alignment.show_taxel(taxel)
        self.plots.toggle_alone(taxel)
        self.taxel_strip.show_chosen(self.plots.time_plots.taxels)
