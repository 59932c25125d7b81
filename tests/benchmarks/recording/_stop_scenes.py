"""Press STOP in every scene of a window with an engine; print scene and time of each press.

The presses are posted by a thread at their times, as those of a keyboard and a mouse are: what
holds the window's thread holds them. The longest turn of the event loop in each scene is measured
in processor time of that thread, which a busy computer changes less.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QAbstractEventDispatcher, QEvent, QPointF, Qt
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget
from shiboken6 import delete

from gui.analysis.results import AnalysisResults, plot_page
from gui.analysis.task_values import TrialCourse, TrialData
from gui.analysis.worker import Worker
from gui.app import paused_collector
from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice
from rigctl.boards.drum_states import State
from rigctl.session.sensor_layout import SensorLayout
from tests.gui.made_trials import made_trial
from tests.gui.texts.results_scenes import ORIGIN, largest_accuracy, largest_confusion

SIZE = (1400, 900)
PRESSES, BETWEEN_S, FIRST_S = 6, 0.23, 0.02
LONG_SAMPLES = 600_000
"""Ten minutes in one trial."""
HOUR_SAMPLES = 3_600_000
HOUR_POINTS = 288_000
"""Readings of the load cell in an hour."""
_KEYS = Qt.KeyboardModifier.NoModifier


class Turns:
    """Measures the turns of the event loop: at its beginning or end each one tells."""

    def __init__(self) -> None:
        self.longest_ms = self._begun_s = 0.0
        dispatcher = QAbstractEventDispatcher.instance()
        dispatcher.awake.connect(self._turn)
        dispatcher.aboutToBlock.connect(self._turn)

    def begin(self) -> None:
        """Forget the turns of before."""
        self.longest_ms, self._begun_s = 0.0, time.thread_time()

    def _turn(self) -> None:
        now_s = time.thread_time()
        self.longest_ms = max(self.longest_ms, 1000 * (now_s - self._begun_s))
        self._begun_s = now_s


class StopScenes:
    """A window, and the planned times of the presses in each scene."""

    def __init__(self, session: str, hour: str) -> None:
        self._session, self._hour = session, hour
        self.window = MainWindow(choice=ThemeChoice.LIGHT)
        self.window.resize(*SIZE)
        self.presses: list[tuple[str, float]] = []
        self.turns, self.turns_ms = Turns(), dict[str, float]()

    def connect(self) -> None:
        """Connect to a virtual rig in real time, and press until the force is held."""
        self.window.show()
        self.window.prepare()
        self.window.connect_rig("virtual")
        link = self.window.engine_link
        self._until(lambda: link.status.drum_connected and link.status.taxels_connected)
        for command, state in (("arm", State.ARMED), ("tare", State.ARMED), ("home", State.ARMED)):
            self._command(command, state)

    def play(self) -> None:
        """Press STOP in each scene."""
        self._command("approach", State.HOLD)
        actions = {action.text(): action for _, action in self.window.menus.actions()}
        self._scene("theme", actions["Dark"].trigger)
        self._command("approach", State.HOLD)
        self._scene("text size", actions["130 %"].trigger)
        self._command("approach", State.HOLD)
        for name, action in self._scenes():
            self._scene(name, action)

    def restyled_ms(self) -> float:
        """Return how long the window is busy with another theme."""
        begun_s = time.perf_counter()
        self.window.set_theme(ThemeChoice.DARK)
        QApplication.processEvents()
        return 1000 * (time.perf_counter() - begun_s)

    def _scenes(self) -> Iterator[tuple[str, Callable[[], object]]]:
        window, tab = self.window, self.window.analysis_tab
        yield "live plots", lambda: window.show_panel("operate")
        yield "size of the window", lambda: window.resize(1000, 700)
        widths_px = window.docks.asked_widths_px()
        wider = {name: px + 80 for name, px in widths_px.items()}
        yield "docks", lambda: window.docks.set_side_widths(wider)
        yield "panel Protocol", lambda: window.show_panel("protocol")
        yield "trials and notes", lambda: window.protocol_panel.page.open_session(self._session)
        yield "panel Analysis", lambda: window.show_panel("analysis")
        tab.panel.folder.setText(self._session)
        yield "a session of 24,000 trials", tab.panel.open_button.click
        trial = _long_trial()
        yield "a trial of ten minutes", lambda: tab.trial_view.show_trial(trial)
        yield "an hour of force and speed", lambda: tab.trial_view.setCurrentIndex(1)
        yield from self._scenes_of_an_hour()
        window.show_panel("analysis")
        tab._analysed = self._session
        pages = (
            plot_page("Accuracy", ORIGIN, largest_accuracy()),
            plot_page("Confusion", ORIGIN, *largest_confusion()),
        )
        results = AnalysisResults("done", pages, name="large")
        yield "results", lambda: tab._finish("analyse", results)
        for suffix in ("png", "svg", "pdf"):
            yield f"picture {suffix}", window.save_menu.actions[suffix].trigger
        self._until(lambda: not tab.reader.is_busy)

    def _scenes_of_an_hour(self) -> Iterator[tuple[str, Callable[[], object]]]:
        """Yield scenes with an hour's trial, again until it has been read."""
        window, tab, page = self.window, self.window.analysis_tab, self.window.replay.page
        tab.panel.folder.setText(self._hour)
        yield "a trial of an hour", tab.panel.open_button.click
        yield from _until_idle("a trial of an hour", tab.reader)
        plot = tab.trial_view.readings.samples_plot
        yield "a second of an hour", lambda: plot.setXRange(1800, 1801, padding=0)
        yield "page Replay", window.replay.show
        yield "a replay of an hour", lambda: page.open(self._hour)
        yield from _until_idle("a replay of an hour", page.worker)
        yield "half an hour later", lambda: page.place.setValue(HOUR_SAMPLES // 2)
        yield from _until_idle("half an hour later", page.worker)
        window.replay.hide()

    def _scene(self, name: str, action: Callable[[], object]) -> None:
        begun_s = time.monotonic() + FIRST_S
        times_s = [begun_s + BETWEEN_S * number for number in range(PRESSES)]
        events = [self._events(number) for number in range(PRESSES)]
        thread = threading.Thread(target=_post, args=(times_s, events))
        thread.start()
        self.turns.begin()
        action()
        self._until(lambda: not thread.is_alive())
        QTest.qWait(300)
        self.turns_ms[name] = max(self.turns.longest_ms, self.turns_ms.get(name, 0.0))
        self.presses += [(name, at_s) for at_s in times_s]

    def _events(self, number: int) -> list[tuple[QWidget, QEvent]]:
        """Return a press of Esc or of the button, in turn, with its receivers."""
        if number % 2:
            button = self.window.toolbar.stop_button
            return [(button, event) for event in _click(button)]
        kinds = (QEvent.Type.KeyPress, QEvent.Type.KeyRelease)
        return [(self.window, QKeyEvent(kind, Qt.Key.Key_Escape, _KEYS)) for kind in kinds]

    def _command(self, command: str, state: State) -> None:
        link = self.window.engine_link
        self._until(lambda: link.status.state is not State.RETRACT)
        link.request(command)
        self._until(lambda: not link.is_waiting and link.status.state is state)

    def _until(self, done: Callable[[], bool]) -> None:
        while not done():
            QTest.qWait(5)


def _until_idle(name: str, worker: Worker) -> Iterator[tuple[str, Callable[[], object]]]:
    while worker.is_busy:
        yield name, lambda: None


def _long_trial() -> TrialData:
    rng, layout = np.random.default_rng(0), SensorLayout.default(18)
    samples = rng.integers(0, 1023, (LONG_SAMPLES, 18)).astype(np.uint16)
    rows, at = rng.integers(0, 36, LONG_SAMPLES), rng.integers(0, LONG_SAMPLES, LONG_SAMPLES)
    at_s = np.arange(HOUR_POINTS) / 80
    course = TrialCourse(at_s, 250 + rng.random(HOUR_POINTS), at_s, at_s * 0 + 40, 250.0, 40.0)
    return made_trial(samples, rows, at, layout, course)


def _click(button: QWidget) -> list[QEvent]:
    at, left, none = QPointF(10, 10), Qt.MouseButton.LeftButton, Qt.MouseButton.NoButton
    on_screen = QPointF(button.mapToGlobal(button.rect().center()))
    kinds = {QEvent.Type.MouseButtonPress: left, QEvent.Type.MouseButtonRelease: none}
    return [
        QMouseEvent(kind, at, on_screen, left, buttons, _KEYS) for kind, buttons in kinds.items()
    ]


def _post(times_s: list[float], presses: list[list[tuple[QWidget, QEvent]]]) -> None:
    for at_s, events in zip(times_s, presses, strict=True):
        time.sleep(max(0.0, at_s - time.monotonic()))
        for receiver, event in events:
            QApplication.postEvent(receiver, event)


def main() -> None:
    """Play the scenes once somebody listens to the engine and says so by a line."""
    session, hour = sys.argv[1:]
    pg.mkQApp()
    with paused_collector():  # as the program makes its window
        scenes = StopScenes(session, hour)
    scenes.connect()
    print("connected", flush=True)
    sys.stdin.readline()
    scenes.play()
    answer = {"presses": scenes.presses, "turns_ms": scenes.turns_ms}
    print(json.dumps({**answer, "restyled_ms": scenes.restyled_ms()}), flush=True)
    scenes.window.close()
    delete(scenes.window)
