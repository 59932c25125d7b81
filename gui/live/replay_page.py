"""The page of a replay: session, trial, speed, the live views, and v(t) of a neuron."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QElapsedTimer, QObject, QRectF, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QAbstractSpinBox, QCheckBox, QLineEdit, QScrollBar, QWidget

from gui.analysis.export import foot_text
from gui.analysis.note_box import NoteBox
from gui.analysis.task_values import DRUM, NeuronVoltage, Section, SessionTable
from gui.analysis.trial_sections import AHEAD_S, ReplayTrial, append_course, append_samples
from gui.analysis.worker import Worker
from gui.live.live_data import LiveData
from gui.live.live_plots import LivePlots, gap_px, right_column_px
from gui.live.navigation import SPANS_S, Overlay
from gui.live.pointer import Pointer, cursor_text
from gui.live.spike_sound import SpikeSound
from gui.live.time_plots import IN_TRIAL
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import ComboBox, FlowLayout, push_button, vbox
from gui.widgets.number_box import NumberBox, WholeNumberBox, has_refused
from gui.widgets.plot_axes import PlotGrid, label_axis, time_plot
from gui.widgets.theme import Theme, scaled_px
from gui.widgets.typed_paths import typed_path
from rigctl.analysis.files import PARTIAL
from rigctl.errors import WrongUse
from rigctl.values import SAMPLE_RATE_HZ

LOW_MV, HIGH_MV = -90.0, 40.0
HEIGHT_PX = 102
_MARGIN_PX, _TOP_PX = 9, 8
_TICKS = [(-70.0, "−70"), (30.0, "30")]


class VoltagePlot(PlotGrid):
    """v(t) of SA and RA of one taxel, as in the paper's Figure 2D, below plots with the times."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        names = ("SA", "RA")
        self.plots = [
            time_plot(self.cells, row, f"{name}<br>(mV)", last=False)
            for row, name in enumerate(names)
        ]
        self.curves = [pg.PlotCurveItem(skipFiniteCheck=True) for _ in names]
        self.overlays = [Overlay(theme, names_marks=False) for _ in names]
        for plot, curve, overlay in zip(self.plots, self.curves, self.overlays, strict=True):
            plot.setYRange(LOW_MV, HIGH_MV, padding=0)
            plot.getAxis("left").setTicks([_TICKS, []])
            plot.getAxis("bottom").setTicks([[], []])
            plot.addItem(curve)
            plot.addItem(overlay)
        self.plots[1].setXLink(self.plots[0])
        self.voltage = NeuronVoltage(0, 0, np.zeros((0, 2)))
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme and the size of the texts."""
        self._theme = theme
        self.setFixedHeight(scaled_px(HEIGHT_PX))
        right_px = _MARGIN_PX + gap_px() + right_column_px()  # times stand below each other
        self.cells.layout.setContentsMargins(_MARGIN_PX, scaled_px(_TOP_PX), right_px, 0)
        self.colour(theme, *self.plots)
        pens = zip(self.curves, theme.groups[:2], self.overlays, strict=True)
        for curve, colour, overlay in pens:
            curve.setPen(pg.mkPen(colour, width=1))
            overlay.set_theme(theme)

    def show_voltage(self, voltage: NeuronVoltage) -> None:
        """Show a part of the voltages of a taxel."""
        self.voltage = voltage
        for plot, name in zip(self.plots, ("SA", "RA"), strict=True):
            label_axis(plot, "left", f"{name}-{voltage.taxel + 1}<br>(mV)", self._theme)

    def has(self, taxel: int, first: int, end: int) -> bool:
        """Return whether a taxel's voltages in these samples are there."""
        voltage = self.voltage
        has_end = voltage.first + len(voltage.voltage_mv) >= end
        return voltage.taxel == taxel and voltage.first <= first and has_end

    def show_window(self, left_s: float, right_s: float) -> None:
        """Show a part of the time axis, up to its right end."""
        begun = self.voltage.first
        first = max(begun, round(left_s * SAMPLE_RATE_HZ))
        end = max(first, round(right_s * SAMPLE_RATE_HZ) + 1)
        shown = self.voltage.voltage_mv[first - begun : end - begun]
        time_s = (first + np.arange(len(shown))) / SAMPLE_RATE_HZ
        for channel, curve in enumerate(self.curves):
            curve.setData(time_s, np.ascontiguousarray(shown[:, channel]))
        self.plots[0].setXRange(left_s, right_s, padding=0)
        for plot, overlay in zip(self.plots, self.overlays, strict=True):
            overlay.set_rect(QRectF(plot.getViewBox().viewRect()))


class Player:
    """``position``: the sample that is shown last, from 0; ``speed``: times real time.

    ``read``: the last sample that is there; time waits for the next ones.
    """

    def __init__(self) -> None:
        self.length = 0
        self.read = sys.maxsize
        self.speed = 1.0
        self.position = 0.0
        self._clock = QElapsedTimer()

    @property
    def is_playing(self) -> bool:
        """Whether time goes on."""
        return self._clock.isValid()

    @property
    def has_ended(self) -> bool:
        """Whether the last sample is shown."""
        return self.position >= self.length - 1

    def play(self) -> None:
        """Go on, from the beginning if the end is reached."""
        if self.has_ended:
            self.position = 0.0
        self._clock.start()

    def stop(self) -> None:
        """Stay where the replay is."""
        self._clock.invalidate()

    def advance(self) -> None:
        """Move on by the time that has passed; stop at the end."""
        if self.is_playing:
            passed_s = self._clock.restart() / 1000
            to = min(self.position + passed_s * self.speed * SAMPLE_RATE_HZ, self.read)
            self.move_to(max(self.position, to))
            if self.has_ended:
                self.stop()

    def move_to(self, position: float) -> None:
        """Show another moment."""
        self.position = min(max(position, 0.0), max(0.0, self.length - 1.0))


LONGEST_S = 10.0
MOVIE, CANCEL = "Movie", "Cancel"
TIP = "Write the time before this moment of the chosen taxel beside the session"


class MovieMaker(QObject):
    """The controls of movies; ``button`` starts one and cancels it while it is drawn."""

    requested = Signal()
    """The button, while no movie is drawn."""
    told = Signal(str)
    """What happens, in words."""
    saved = Signal(str)
    """The path of a whole movie."""
    failed = Signal(str)
    """One sentence."""

    def __init__(self) -> None:
        super().__init__()
        self.kind = ComboBox()
        for name, end in (("GIF", ".gif"), ("MP4", ".mp4")):
            self.kind.addItem(name, end)
        self.kind.setToolTip("Kind of the movie; an MP4 needs ffmpeg on this computer")
        self.length = NumberBox(minimum=0.1, maximum=LONGEST_S, value=1.0, decimals=1)
        self.length.setSuffix(" s")
        self.length.setToolTip("How much of the trial the movie shows")
        self.button = push_button(MOVIE, self._click, TIP)
        self._out: Path | None = None
        self.worker = Worker()
        self.worker.progressed.connect(lambda stage, share: self.told.emit(f"{stage}: {share:.0%}"))
        self.worker.finished.connect(lambda _, path: self._end(path))
        self.worker.failed.connect(lambda _, sentence: self._fail(sentence))

    @property
    def controls(self) -> tuple[QWidget, ...]:
        """Length, kind and button, each with its label."""
        return label("Last"), self.length, label("as"), self.kind, self.button

    def write(self, session: str, place: Path, row: int, taxel: int, end_s: float) -> None:
        """Draw the time before a moment of an attempt for a taxel into a folder; all from 0."""
        start_s = max(0.0, end_s - self.length.value())
        folder = typed_path(session)
        name = f"{folder.name}-attempt{row + 1}-T{taxel + 1}-{start_s:.3f}s"
        self._out = out = place / (name + self.kind.currentData())
        section_s = (start_s, self.length.value())
        about = {"path": session, "row": row, "taxel": taxel}
        self.worker.submit("trial_movie", **about, section_s=section_s, out=str(out))
        self.button.setText(CANCEL)
        self.told.emit(f"drawing {out} …")

    def cancel(self) -> None:
        """End the drawing; no movie is left."""
        self.worker.cancel()
        self.button.setText(MOVIE)
        if self._out is not None:
            # The process had no time to remove what it had drawn.
            self._out.with_name(PARTIAL.format(name=self._out.name)).unlink(missing_ok=True)
            self._out = None

    def _click(self) -> None:
        if self.worker.is_busy:
            self.cancel()
            self.told.emit("The movie is cancelled.")
        elif not has_refused(self.length):
            self.requested.emit()

    def _end(self, path: str) -> None:
        self._out = None
        self.button.setText(MOVIE)
        self.saved.emit(path)

    def _fail(self, sentence: str) -> None:
        self._out = None
        self.button.setText(MOVIE)
        self.failed.emit(sentence)


VOLTAGE_SAMPLES = 10 * SAMPLE_RATE_HZ
"""Of a long trial, v(t) stands in the last part of the window: it takes a tenth of its time."""
VOLTAGE_MARGIN = 5 * SAMPLE_RATE_HZ
VOLTAGE_SPEED = 4.0
"""A long trial that plays faster has no v(t)."""
AHEAD_SAMPLES = AHEAD_S * SAMPLE_RATE_HZ
FOLLOW_MS = 1000
NOTE = "note"
"""Kind of the marks of notes."""
NEWEST = 1 << 31
"""As the row of an attempt: the last one that there is."""
NO_ATTEMPT = "No attempt has ended yet: the first one is shown as soon as it has."
NO_SESSION = "Open a session to replay its trials."
MAX_SPAN_S = 10
"""Of a session that opens: a longer trial scrolls as live."""
OFFERED = "Press Return in the field to replay the last session, or choose another one."


class ReplayPage(QWidget):
    """Plays trials; :meth:`poll` moves the time."""

    reported = Signal(str, str)
    """Kind and text for the event log."""
    closed = Signal()
    """Back to the other pages."""
    path_requested = Signal(object, object)
    """A :class:`PathKind`, and the function that takes the chosen path."""
    opened = Signal(str)
    """The path of a session that is open."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.plots, self.voltage = LivePlots(theme), VoltagePlot(theme)
        self.plots.caption_paused = IN_TRIAL
        self.pointer, self.player, self.worker = Pointer(self.plots), Player(), Worker()
        self._table, self._row, self._shown = SessionTable(), -1, -1
        """The session, the attempt that is wanted of it, and the one that is shown."""
        self._wanted: tuple[str, int] | None = None
        """Path and row of a trial whose session is being opened."""
        self._is_late = self._plays = self._fits_span = False
        self._build_controls()
        self.sentence, self.values = ElidedLabel(NO_SESSION, "muted"), ElidedLabel()
        self.growth = ElidedLabel("", "muted")
        """How old the newest data of a session are that is still recorded."""
        rows = (FlowLayout(*self._session_row), FlowLayout(*self._play_row))
        self.setLayout(
            vbox(
                *rows,
                self.note_box,
                self.growth,
                self.sentence,
                self.plots,
                self.voltage,
                self.values,
                spacing=3,
                tall=5,
            )
        )
        self._connect()

    def poll(self) -> None:
        """Show the present moment."""
        if not self.isVisible() or not self.player.is_playing:
            return
        self.player.advance()
        self.show_moment()
        shown = round(self.player.position)
        self.sound.follow(self.plots.data.history, shown, self.player.speed)
        if self.player.has_ended and self.whole_session.isChecked():
            self._next_trial()
        self._show_play()

    def open(self, path: str, row: int = 0, *, plays: bool = False) -> None:
        """Show an attempt of a session, from 0; ``plays`` starts it as soon as it is read."""
        self.session.setText(path)
        self.player.stop()
        self._show_play()
        self._plays = plays
        if path == self._table.path and row < self._table.n_rows:
            self._wanted = None
            self._choose(row)
        else:
            self._wanted = path, row
            self.worker.submit("open_session", path=path)
        show_text(self.sentence, f"reading {path} …")

    def follow(self, path: str) -> None:
        """Show the newest attempt of a session that grows, and each that comes."""
        self.whole_session.setChecked(True)
        self.open(path, NEWEST, plays=True)

    def offer(self, path: str) -> None:
        """Put the path of a session into an empty field; Return there opens it."""
        if not self.session.text():
            self.session.setText(path)
            show_text(self.sentence, OFFERED)
            self.session.setFocus()

    def close_files(self) -> None:
        """End the worker processes, as before the window closes."""
        self.worker.close()
        self.movies.cancel()
        self.movies.worker.close()
        self.sound.close_files()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)
        self.voltage.set_theme(theme)

    def show_moment(self) -> None:
        """Draw what the trial showed up to the present moment."""
        navigation = self.plots.navigation
        navigation.look_at(round(self.player.position), 0)
        self.plots.draw()
        self._follow_window()

    def _build_controls(self) -> None:
        self.session = QLineEdit()
        self.session.setPlaceholderText("session folder")
        self.session.setMinimumWidth(120)
        self.trial = WholeNumberBox(minimum=1, maximum=1)
        self.whole_session = QCheckBox("go on to the next")
        browse = browse_button(self.path_requested, PathKind.SESSION, self.open)
        row: tuple[QWidget, ...] = (
            label("Session"),
            self.session,
            browse,
            label("Attempt"),
            self.trial,
        )
        back = push_button("Back", self.closed.emit, "Back to the live plots")
        self._session_row = (*row, self.whole_session, back)
        self.play = push_button("Play", self._toggle, "Play or stop")
        self.place = QScrollBar(Qt.Orientation.Horizontal)
        self.place.setAccessibleName("Place in the trial")
        self.speed = NumberBox(minimum=0.001, maximum=1000.0, decimals=3, value=1.0)
        self.speed.setPrefix("× ")
        self.speed.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)
        self.speed.setToolTip("Speed of the replay in times real time")
        self.movies, self.sound = MovieMaker(), SpikeSound()
        self.note_box = NoteBox("at this moment", "A mark on the plots where the replay stands")
        self.author: Callable[[], str] = str
        """Returns who writes notes."""
        self.place_of: Callable[[str], Path] = lambda path: typed_path(path).absolute().parent
        """Returns where movies of a session go. Raises WrongUse."""
        self.place.setMinimumWidth(120)
        played = (self.play, self.place, label("Speed"), self.speed)
        self._play_row = (*played, *self.movies.controls, *self.sound.controls)

    def _connect(self) -> None:
        worker, pointer = self.worker, self.pointer
        worker.finished.connect(self._finish)
        worker.failed.connect(self._fail)
        worker.progressed.connect(self._show_progress)
        self.note_box.written.connect(self._note)
        movies = self.movies
        movies.requested.connect(self._write_movie)
        movies.told.connect(lambda words: show_text(self.sentence, words))
        movies.saved.connect(self._show_saved)
        movies.failed.connect(lambda sentence: self._fail("trial_movie", sentence))
        self.session.returnPressed.connect(self._open_typed)
        self.trial.valueChanged.connect(lambda _: self._load(self.trial.value() - 1))
        self.speed.valueChanged.connect(lambda speed: setattr(self.player, "speed", speed))
        self.place.valueChanged.connect(self._seek)
        pointer.taxel_changed.connect(lambda _: self._read_on())
        pointer.taxel_changed.connect(self.sound.show_taxel)
        self.sound.failed.connect(partial(self._fail, "sound"))
        pointer.enlarge_requested.connect(self.plots.toggle_alone)
        self.plots.lines_changed.connect(self._show_values)
        self.plots.navigation.changed.connect(self._follow_window)
        self._follow_timer = QTimer(self, interval=FOLLOW_MS)
        self._follow_timer.timeout.connect(self._follow_session)
        self._follow_timer.start()

    def _open_typed(self) -> None:
        if path := self.session.text().strip():
            self.open(path)
        else:
            show_text(self.sentence, NO_SESSION)

    def _toggle(self) -> None:
        if self.player.is_playing:
            self.player.stop()
        elif self.player.length:
            self.player.play()
        self._show_play()

    def _seek(self, position: int) -> None:
        self.player.move_to(position)
        self.show_moment()

    def _choose(self, row: int) -> None:
        with QSignalBlocker(self.trial):
            self.trial.setValue(row + 1)
        self._load(row)

    def _load(self, row: int) -> None:
        """Read an attempt; of several that were chosen quickly, only the last one."""
        self._row, self._is_late = row, self.worker.is_busy
        self._shown = -1
        if not self._is_late:
            self._read_around(0)

    def _read_around(self, right: int) -> None:
        """Read what stands in windows that end at about this sample."""
        self.worker.submit("load_replay", path=self._table.path, row=self._row, right=right)

    def _follow_session(self) -> None:
        """Look for what was recorded since, while the page is shown and its session grows."""
        if self._table.is_growing and self.isVisible() and not self.worker.is_busy:
            self.worker.submit("follow_session", path=self._table.path)
            self.worker.submit("session_age", path=self._table.path)

    def _grow(self, table: SessionTable) -> None:
        """Offer the attempts that have come; go on to the next where that is wanted."""
        had = self._table.n_rows
        self._show_rows(table)
        if not had:
            self._choose(0)
        elif self.whole_session.isChecked() and self.player.has_ended:
            self._next_trial()

    def _show_age(self, age_s: float) -> None:
        attempts = f"{self._table.n_rows} attempts"
        show_text(self.growth, f"Recording: {attempts}, newest data {age_s:.1f} s old")

    def _next_trial(self) -> None:
        if self.trial.value() < self.trial.maximum():
            self._plays = True
            self.trial.setValue(self.trial.value() + 1)

    def _read_on(self) -> None:
        """Read what the window shows of a long trial, soon what follows, and the voltages."""
        window, history = self.plots.navigation.window, self.plots.data.history
        n = self.player.length
        if self._shown != self._row or not n or self.worker.is_busy:
            return
        place = {"path": self._table.path, "row": self._row}
        right, end = min(max(window.right, 0), n - 1), history.newest + 1
        if right >= end or max(window.left, 0) < min(history.oldest, right):
            self._read_around(right)
        elif end < min(n, right + AHEAD_SAMPLES // 2):
            ahead = {"first": end, "end": min(n, end + AHEAD_SAMPLES), "factor": 1}
            self.worker.submit("trial_section", **place, **ahead)
        elif self.player.speed <= VOLTAGE_SPEED or not self.player.is_playing:
            self._read_voltage(place, max(0, window.left, right - VOLTAGE_SAMPLES), right + 1)

    def _read_voltage(self, place: dict[str, Any], first: int, end: int) -> None:
        taxel = self.pointer.taxel
        if not self.voltage.has(taxel, first, end):
            first = max(0, end - VOLTAGE_SAMPLES - VOLTAGE_MARGIN)
            end = min(end + VOLTAGE_MARGIN, self.player.length)
            self.worker.submit("neuron_voltage", **place, taxel=taxel, first=first, end=end)

    def _append(self, section: Section) -> None:
        """Add the samples that follow, if nothing else was read since they were asked for."""
        data = self.plots.data
        if section.first == data.history.newest + 1:
            append_samples(data.history, section.first, section.low, section.spikes)
            if section.course is not None:
                append_course(data.drum, section.course)
            self.player.read = data.history.newest

    def _finish(self, task: str, result: Any) -> None:
        if task == "open_session":
            self._show_table(result)
        elif task == "follow_session" and result is not None:
            self._grow(result)
        elif task == "session_age":
            self._show_age(result)
        elif task == "note_trial":
            self._show_rows(result)
            self._offer_note()
        elif task == "load_replay":
            self._show_trial(result)
        elif task == "trial_section":
            self._append(result)
        elif task == "neuron_voltage":
            self.voltage.show_voltage(result)
        self._read_late()
        self._follow_window()

    def _read_late(self) -> None:
        if self._is_late and not self.worker.is_busy:
            self._load(self._row)

    def _show_table(self, table: SessionTable) -> None:
        """Show the wanted attempt of a session, unless another one was asked for since."""
        if self._wanted is None or self._wanted[0] != table.path:
            return
        row, self._wanted = self._wanted[1], None
        if table.experiment != DRUM or not (table.n_rows or table.is_growing):
            self._fail("open_session", "this is no session of the drum with trials: open another")
            return
        self._row, self._shown, self._fits_span = -1, -1, True
        self._show_rows(table)
        self.opened.emit(table.path)
        if table.n_rows:
            self._choose(min(row, table.n_rows - 1))
        else:
            show_text(self.sentence, NO_ATTEMPT)

    def _show_rows(self, table: SessionTable) -> None:
        self._table = table
        self.growth.setVisible(table.is_growing)
        with QSignalBlocker(self.trial):
            self.trial.setRange(1, max(1, table.n_rows))

    def _show_trial(self, trial: ReplayTrial) -> None:
        data = LiveData(trial.layout.n_taxels, trial.history, trial.drum)
        for mark in trial.marks:
            data.add_event(mark.at_s, NOTE, mark.text, {})
        self._offer_note()
        data.low, data.high = trial.low.astype(float), trial.high.astype(float)
        self.plots.show_data(data, trial.layout)
        n = trial.n_samples
        if self._fits_span:  # with the first trial of a session; a span chosen later stays
            self._fits_span = False
            self.plots.set_span(_fitting_span_s(n / SAMPLE_RATE_HZ))
        self.player.read = trial.history.newest
        if self._shown == trial.row:  # another part of it
            self.plots.draw()
            return
        self._shown = trial.row
        self.voltage.show_voltage(NeuronVoltage(self.pointer.taxel, 0, np.zeros((0, 2))))
        self.player.length, self.player.position = n, 0.0
        with QSignalBlocker(self.place):
            self.place.setRange(0, max(0, n - 1))
        show_text(self.sentence, foot_text(trial.title, simulated=trial.simulated))
        if self._plays and not self._is_late:
            self._plays = False
            self.player.play()
        self.show_moment()
        self._show_play()

    def _fail(self, task: str, sentence: str) -> None:
        if task == "open_session":
            self._table, self._row, self.player.length = SessionTable(), -1, 0
        show_text(self.sentence, sentence)
        self.reported.emit("refused", sentence)
        self._read_late()

    def _show_progress(self, stage: str, share: float) -> None:
        show_text(self.sentence, f"{stage}: {share:.0%}")

    def _show_play(self) -> None:
        self.play.setText("Pause" if self.player.is_playing else "Play")

    def _follow_window(self) -> None:
        window = self.plots.navigation.window
        self.voltage.show_window(window.left_s, window.right_s)
        with QSignalBlocker(self.place):
            self.place.setValue(round(self.player.position))
        self._show_values()
        self._read_on()

    def _show_values(self) -> None:
        plots = self.plots
        window = plots.navigation.window
        position = plots.cursors.position(window)
        scale, taxel = plots.value_scale, self.pointer.taxel
        show_text(self.values, cursor_text(plots.data, window, position, taxel, scale))

    def _offer_note(self) -> None:
        self.note_box.show_trial(self._table.possible_mark(self._row), has_trial=True)

    def _note(self, text: str, mark: str) -> None:
        """Write a note at the moment that is shown, and mark it there."""
        at_s = round(self.player.position / SAMPLE_RATE_HZ, 3)
        note = {"text": text, "author": self.author(), "mark": mark, "at_s": at_s}
        self.worker.submit("note_trial", path=self._table.path, row=self._row, **note)
        self.plots.data.add_event(at_s, NOTE, text, {})
        self.show_moment()
        self.reported.emit("note", f"trial {self._row + 1} at {at_s:.2f} s: “{text}”")

    def _write_movie(self) -> None:
        if self._row < 0:
            show_text(self.sentence, NO_SESSION)
            return
        end_s = self.player.position / SAMPLE_RATE_HZ
        try:
            place = self.place_of(self._table.path)
        except WrongUse as error:
            self._fail("trial_movie", f"Results in: {error}")
            return
        self.movies.write(self._table.path, place, self._row, self.pointer.taxel, end_s)

    def _show_saved(self, path: str) -> None:
        show_text(self.sentence, f"saved {path}")
        self.reported.emit("saved", f"saved {path}")


def _fitting_span_s(trial_s: float) -> int:
    """Return the shortest span that shows a whole trial, up to :data:`MAX_SPAN_S`."""
    return next((span_s for span_s in SPANS_S if trial_s <= span_s <= MAX_SPAN_S), MAX_SPAN_S)
