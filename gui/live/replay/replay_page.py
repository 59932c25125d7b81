"""The page of a replay: session, trial, speed, the live views, and v(t) of a neuron."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QAbstractSpinBox, QCheckBox, QLineEdit, QScrollBar, QWidget

from gui.analysis.export.picture_foot import foot_text
from gui.analysis.tasks.task_values import DRUM, SessionTable
from gui.analysis.tasks.worker import Worker
from gui.live.live_data import LiveData
from gui.live.live_plots import LivePlots
from gui.live.page.pointer import Pointer
from gui.live.page.readout import cursor_text
from gui.live.replay.movie_maker import MovieMaker
from gui.live.replay.player import Player
from gui.live.replay.replay_tasks import ReplayTrial
from gui.live.replay.voltage_plot import VoltagePlot
from gui.live.review.navigation import SPANS_S
from gui.live.time_plots import IN_TRIAL
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import push_button, vbox
from gui.widgets.number_box import NumberBox, WholeNumberBox
from gui.widgets.theme import Theme
from rigctl.values import SAMPLE_RATE_HZ

FOLLOW_MS = 1000
NEWEST = 1 << 31
"""As the row of an attempt: the last one that there is."""
NO_ATTEMPT = "No attempt has ended yet: the first one is shown as soon as it has."
NO_SESSION = "Open a session to replay its trials."
MAX_SPAN_S = 10
"""Of a session that opens: a longer trial scrolls as live."""
OFFERED = "Press Return in the field to replay the last session, or choose another one."


class ReplayPage(QWidget):
    """Plays trials; :meth:`poll` moves the time and takes what the worker process read."""

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
        self._table, self._row = SessionTable(), -1
        self._wanted: tuple[str, int] | None = None
        """Path and row of a trial whose session is being opened."""
        self._is_late = self._plays = self._fits_span = False
        self._build_controls()
        self.sentence, self.values = ElidedLabel(NO_SESSION, "muted"), ElidedLabel()
        self.growth = ElidedLabel("", "muted")
        """How old the newest data of a session are that is still recorded."""
        rows = (FlowLayout(*self._session_row), FlowLayout(*self._play_row))
        column = vbox(
            *rows, self.growth, self.sentence, self.plots, self.voltage, self.values, spacing=3
        )
        column.setStretch(4, 1)
        self.setLayout(column)
        self._connect()

    def poll(self) -> None:
        """Take results of the worker, and show the present moment."""
        self.worker.poll()
        self.movies.worker.poll()
        if not self.isVisible() or not self.player.is_playing:
            return
        self.player.advance()
        self.show_moment()
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
        """End the worker process, as before the window closes."""
        self.worker.cancel()
        self.movies.cancel()

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
        self.movies = MovieMaker()
        self.place.setMinimumWidth(120)
        self._play_row = (self.play, self.place, label("Speed"), self.speed, *self.movies.controls)

    def _connect(self) -> None:
        worker, pointer = self.worker, self.pointer
        worker.finished.connect(self._finish)
        worker.failed.connect(self._fail)
        worker.progressed.connect(self._show_progress)
        movies = self.movies
        movies.requested.connect(self._write_movie)
        movies.told.connect(lambda words: show_text(self.sentence, words))
        movies.saved.connect(self._show_saved)
        movies.failed.connect(lambda sentence: self._fail("trial_movie", sentence))
        self.session.returnPressed.connect(self._open_typed)
        self.trial.valueChanged.connect(lambda _: self._load(self.trial.value() - 1))
        self.speed.valueChanged.connect(lambda speed: setattr(self.player, "speed", speed))
        self.place.valueChanged.connect(self._seek)
        pointer.taxel_changed.connect(lambda _: self._ask_voltage())
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
        if not self._is_late:
            self.worker.submit("load_replay", path=self._table.path, row=row)
            self._ask_voltage()

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

    def _ask_voltage(self) -> None:
        if self._row >= 0:
            place = {"path": self._table.path, "row": self._row, "taxel": self.pointer.taxel}
            self.worker.submit("neuron_voltage", **place)

    def _finish(self, task: str, result: Any) -> None:
        if task == "open_session":
            self._show_table(result)
        elif task == "follow_session" and result is not None:
            self._grow(result)
        elif task == "session_age":
            self._show_age(result)
        elif task == "load_replay":
            self._show_trial(result)
        elif task == "neuron_voltage":
            self.voltage.show_voltage(self.pointer.taxel, result)
            self._follow_window()
        self._read_late()

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
        self._row, self._fits_span = -1, True
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
        data = LiveData(trial.layout.n_taxels, trial.timeline, trial.drum)
        data.low, data.high = trial.low.astype(float), trial.high.astype(float)
        self.plots.show_data(data, trial.layout)
        n = len(trial.timeline)
        if self._fits_span:  # with the first trial of a session; a span chosen later stays
            self._fits_span = False
            self.plots.set_span(_fitting_span_s(n / SAMPLE_RATE_HZ))
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
        self.play.setText("Stop" if self.player.is_playing else "Play")

    def _follow_window(self) -> None:
        window = self.plots.navigation.window
        self.voltage.show_window(window.left_s, window.right_s)
        with QSignalBlocker(self.place):
            self.place.setValue(round(self.player.position))
        self._show_values()

    def _show_values(self) -> None:
        plots = self.plots
        window = plots.navigation.window
        position = plots.cursors.position(window)
        scale, taxel = plots.value_scale, self.pointer.taxel
        show_text(self.values, cursor_text(plots.data, window, position, taxel, scale))

    def _write_movie(self) -> None:
        if self._row < 0:
            show_text(self.sentence, NO_SESSION)
            return
        end_s = self.player.position / SAMPLE_RATE_HZ
        self.movies.write(self._table.path, self._row, self.pointer.taxel, end_s)

    def _show_saved(self, path: str) -> None:
        show_text(self.sentence, f"saved {path}")
        self.reported.emit("saved", f"saved {path}")


def _fitting_span_s(trial_s: float) -> int:
    """Return the shortest span that shows a whole trial, up to :data:`MAX_SPAN_S`."""
    return next((span_s for span_s in SPANS_S if trial_s <= span_s <= MAX_SPAN_S), MAX_SPAN_S)
