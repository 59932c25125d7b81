"""The pictures of the window: the drum's rig, recorded sessions, the moving finger."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QScrollArea, QWidget

from gui.analysis.run_box import METHODS, PAPER, QUICK
from gui.finger.scan_plots import AnswerState
from gui.operate.calibrate import PartPage
from gui.protocol.protocol_panel import LIVE_BUTTON
from gui.shell.main_window import MainWindow
from gui.widgets.file_browser import PathKind
from gui.widgets.theme import ThemeChoice
from rigctl.boards.drum_states import State
from rigctl.boards.port_discovery import PortReport
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.engine.setup.boards import installed_build
from rigctl.values import BoardIdentity
from tools.screenshots.camera import THEMES, Camera

FINGER_SEED = "1"
_FINGER = ("--protocol", "quick", "--yes", "--seed", FINGER_SEED, "--out")


class Recordings:
    """A session of the drum, and models of the finger, below a folder; made one after the other.

    Their engines are not among those that the window finds.
    """

    def __init__(self, work: Path) -> None:
        self.session, self.model = work / "quick", work / "finger-calibrate"
        train = str(work / "finger-train")
        commands = (
            ("run", "quick", "--yes", "--seed", "1", "--out", str(self.session)),
            ("realtime", "train", *_FINGER, train),
            ("realtime", "calibrate", *_FINGER, str(self.model), "--model", train),
        )
        self._waiting = list(commands)
        self._environment = os.environ | {FOLDER_VARIABLE: str(work / "recording")}
        self._present: subprocess.Popen[bytes] | None = None
        self.n_done = 0
        self.advance()

    @property
    def has_session(self) -> bool:
        """Whether the session of the drum is complete."""
        self.advance()
        return self.n_done >= 1

    @property
    def has_model(self) -> bool:
        """Whether the finger's models are complete."""
        self.advance()
        return self.n_done == 3

    def advance(self) -> None:
        """Begin the next recording where one has ended. Raises SystemExit if that failed."""
        if self._present is not None:
            if (code := self._present.poll()) is None:
                return
            if code:
                raise SystemExit(f"a recording failed with exit code {code}: see above")
            self.n_done += 1
            self._present = None
        if self._waiting:
            words = [sys.executable, "-m", "rigctl", *self._waiting.pop(0)]
            self._present = subprocess.Popen(
                words, stdout=subprocess.DEVNULL, env=self._environment
            )

    def end(self) -> None:
        """End what still records."""
        if self._present is not None:
            self._present.terminate()
            self._present.wait()


SAVE_IN = "~/rigctl-sessions"
"""What fields for folders show, on whatever computer."""


def always() -> bool:
    """Return that a scene that does not move is ready."""
    return True


@dataclass(frozen=True, slots=True)
class Scene:
    """A name, and when to take the picture. ``choice``: the only theme, None for both."""

    name: str
    ready: Callable[[], bool] = field(default=always)
    choice: ThemeChoice | None = None


@dataclass(frozen=True, slots=True)
class Studio:
    """The window, its camera, a folder to work in, and what is recorded there."""

    window: MainWindow
    camera: Camera
    work: Path
    recordings: Recordings


RIDGES = """\
name = "ridges"
description = "Three ridged plates, for pictures."
textures = ["D", "I", "L"]
speeds_mm_s = [40, 60]
forces_g = [500]
repeats = 6
"""
MIN_TRIALS = 2
MASSES_G, STEPS = (200.0, 500.0), 7


def drum_scenes(studio: Studio) -> Iterator[Scene]:
    """Show the start page and a connected rig, then a run; it goes on at the end."""
    window = studio.window
    window.show_panel("operate")
    window.start.show_page()
    yield Scene("start")
    window.start.back.click()
    _scroll_to(window.operate_panel.bring_up)
    yield Scene("bring-up")
    yield from _calibration_scenes(studio)
    yield from setup_scenes(studio)
    window.attach.list_engines()
    studio.camera.wait(window.attach.engines.isVisible)
    yield Scene("engines")
    window.attach.engines.closed.emit()
    _start_run(studio)
    window.show_panel("operate")
    _scroll_to(window.operate_panel.buttons["arm"])
    yield Scene("window", lambda: advance_run(window))
    window.show_panel("protocol")
    yield Scene("protocol", lambda: advance_run(window))
    yield from _protocol_pages(studio)


def _calibration_scenes(studio: Studio) -> Iterator[Scene]:
    """Calibrate the load cell, and identify some taxels."""
    window, page = studio.window, studio.window.tools.calibrate_page
    part = page.load_cell
    window.tools.show_calibration(part.part)
    for number, mass_g in enumerate((MASSES_G[0], *MASSES_G)):
        part.mass.setValue(mass_g)
        _press_and_wait(studio, part, partial(_has_masses, window, number + 1))
    yield Scene("calibrate-load-cell")
    window.tools.show_calibration(page.wiring.part)
    for step in range(STEPS):
        _press_and_wait(studio, page.wiring, partial(_is_at_step, window, step + 1))
    yield Scene("calibrate-taxel-order")
    page.wiring.discard_button.click()
    page.closed.emit()


def setup_scenes(studio: Studio) -> Iterator[Scene]:
    """Set the rig up, with a picture of each part once it is checked, and of one question."""
    window, page, wait = studio.window, studio.window.tools.setup_page, studio.camera.wait
    window.tools.show_setup()
    yield from _boards_scene(window)
    wait(lambda: page.list.count() > 0)
    for number in range(page.list.count()):
        page.list.setCurrentRow(number)
        wait(page.check_button.isEnabled)
        name = page.part.name
        page.check_button.click()
        yield from _answered(studio, name)
        choice = ThemeChoice.LIGHT if number else None
        yield Scene(f"setup-{number + 1:02}-{name}", partial(_is_right, window, name), choice)
    page.closed.emit()


def _boards_scene(window: MainWindow) -> Iterator[Scene]:
    """Show the first step, as it is before a bench is connected."""
    page, status_changed = window.tools.setup_page, window.engine_link.status_changed
    status_changed.disconnect(page.show_status)
    page.show_status(EngineStatus())
    mega = BoardIdentity("drum", "0.1", installed_build("drum"), 4, 3, 0)
    reports = [
        PortReport("/dev/ttyACM0", "Arduino Mega 2560", mega),
        PortReport("/dev/ttyUSB0", "USB Serial", error="no rigctl board answered"),
    ]
    builds = {board: installed_build(board) for board in ("drum", "taxels")}
    page.boards.worker.found.emit(reports, builds)
    yield Scene("setup-00-boards")
    status_changed.connect(page.show_status)
    page.show_status(window.engine_link.status)


def _answered(studio: Studio, name: str) -> Iterator[Scene]:
    """Answer the questions of a check as the simulated bench does; show the first of the ends."""
    window, page = studio.window, studio.window.tools.setup_page
    answered = 0
    while not _is_right(window, name):
        question_id = window.engine_link.status.setup.question_id
        if page.question.text() and page._asked_id == question_id > answered:
            if name == "ends" and not answered:
                yield Scene("setup-question", choice=ThemeChoice.LIGHT)
            answered = question_id
            window.engine_link.request("setup_answer", question_id=question_id, text="")
        studio.camera.wait(partial(_is_next, window, name, answered))


def _is_next(window: MainWindow, name: str, answered: int) -> bool:
    """Return whether a check has ended or asks another question."""
    page = window.tools.setup_page
    asks = bool(page.question.text()) and page._asked_id > answered
    return _is_right(window, name) or asks


def _is_right(window: MainWindow, name: str) -> bool:
    setup = window.engine_link.status.setup
    state = next(part.state for part in setup.parts if part.name == name)
    assert state != "wrong", window.tools.setup_page.problem.text()
    return state == "right" and not setup.checking


def _press_and_wait(studio: Studio, part: PartPage, is_done: Callable[[], bool]) -> None:
    """Measure, and wait until the page shows the result."""
    wait = studio.camera.wait
    wait(part.measure_button.isEnabled)
    part.measure_button.click()
    wait(is_done)
    wait(part.measure_button.isEnabled)


def _has_masses(window: MainWindow, count: int) -> bool:
    return len(window.engine_link.status.calibration.masses) == count


def _is_at_step(window: MainWindow, step: int) -> bool:
    return window.engine_link.status.calibration.wiring_step == step


def advance_run(window: MainWindow) -> bool:
    """Confirm a prompt, if any; return whether the drum turns under force at its set speed."""
    status = window.engine_link.status
    if status.run.prompt is not None and window.prompt_panel.isVisible():
        window.prompt_panel.confirm.click()
    return status.state is State.RUN and status.speed_mm_s > 0.99 * status.speed_set_mm_s


def _start_run(studio: Studio) -> None:
    """Start the protocol and confirm its prompts until some trials are on disk."""
    window, wait = studio.window, studio.camera.wait
    link, panel = window.engine_link, window.protocol_panel
    panel.out.setText(str(studio.work))
    ridges = studio.work / "ridges.toml"
    ridges.write_text(RIDGES, encoding="utf-8")
    window.show_panel("protocol")
    panel.add_protocol(str(ridges))
    wait(panel.buttons["Start"].isEnabled)
    panel.buttons["Start"].click()
    wait(lambda: advance_run(window))
    panel.out.setText(SAVE_IN)
    wait(lambda: advance_run(window) and link.status.run.trials_committed >= MIN_TRIALS)


def _protocol_pages(studio: Studio) -> Iterator[Scene]:
    """Show each tab of the run's page; the last one is the editor."""
    panel, tabs = studio.window.protocol_panel, studio.window.protocol_panel.page.tabs
    panel.show_page(shows_page=True)
    assert panel.page_button.text() == LIVE_BUTTON
    panel.form.edit_button.click()
    studio.camera.wait(lambda: not panel.worker.is_busy)
    for index in range(tabs.count()):
        tabs.setCurrentIndex(index)
        yield Scene(f"protocol-{file_name(tabs.tabText(index))}", lambda: not panel.worker.is_busy)
    panel.show_page(shows_page=False)


def page_scenes(studio: Studio) -> Iterator[Scene]:
    """Show the pages that need no rig: tools, shortcuts, the file browser."""
    window, stack = studio.window, studio.window.stack
    for name in ("accept", "ports"):
        stack.show_page(name)
        yield Scene(name)
    next(
        action for menu, action in window.menus.actions() if action.text() == "&Shortcuts"
    ).trigger()
    yield Scene("shortcuts")
    window.file_browser.open(PathKind.SESSION, lambda _: None)
    stack.show_page("files")
    yield Scene("files")
    window.file_browser.dismiss()


def file_name(text: str) -> str:
    """Return the text of a tab as a part of a file's name."""
    return text.lower().replace(" ", "-").replace(",", "")


def _scroll_to(widget: QWidget) -> None:
    """Scroll the panel of a widget, so that the widget is in view."""
    parent: QWidget | None = widget
    while parent is not None and not isinstance(parent, QScrollArea):
        parent = parent.parentWidget()
    if isinstance(parent, QScrollArea):
        parent.ensureWidgetVisible(widget)


MIN_NAMED, MIN_WINDOWS = 3, 9


def finger_scenes(studio: Studio) -> Iterator[Scene]:
    """Show the idle tab, then an answer that grows or is right.

    Each theme has a run of its own: a change of the theme delays its answers.
    """
    window, setup = studio.window, studio.window.finger_tab.setup
    window.show_panel("finger")
    setup.out.setText(SAVE_IN)
    yield Scene("finger-idle")
    studio.camera.wait(lambda: studio.recordings.has_model)
    setup.choose_stage("run")
    setup.seed.setValue(int(FINGER_SEED))
    setup.unasked.setChecked(True)
    for choice in THEMES:
        window.set_theme(choice)
        _run_finger(studio)
        window.run_end_strip.hide()
        yield Scene("finger", lambda: _grows(window), choice)


def _run_finger(studio: Studio) -> None:
    """Run the real-time stage on a new engine until some scans are named."""
    tab, wait = studio.window.finger_tab, studio.camera.wait
    if tab.link.is_connected:
        tab.link.request("abort")
        wait(lambda: tab.link.status.run.has_ended)
        tab.link.close()
    tab.setup.model.setText(str(studio.recordings.model))
    tab.setup.out.setText(str(studio.work))
    wait(tab.run_box.buttons["Start"].isEnabled)
    tab.run_box.buttons["Start"].click()
    wait(lambda: tab.link.status.run.is_active)
    tab.setup.out.setText(SAVE_IN)
    tab.setup.model.setText(f"{SAVE_IN}/{studio.recordings.model.name}")
    wait(lambda: tab.link.status.run.classified >= MIN_NAMED)


def _grows(window: MainWindow) -> bool:
    """Return whether the answer is right, or grows and has seen most of the plate."""
    record = window.finger_tab.view.record
    row = record.prediction
    is_late = row is not None and row.windows >= MIN_WINDOWS
    return record.state is AnswerState.RIGHT or (record.state is AnswerState.GROWING and is_late)


REPLAYED_MS = 1200
FEW_DRAWS = 2


def recorded_scenes(studio: Studio) -> Iterator[Scene]:
    """Show the pages of a trial, the figure of the quick check, a report, and the replay."""
    window, wait = studio.window, studio.camera.wait
    wait(lambda: studio.recordings.has_session)
    window.show_panel("analysis")
    window.analysis_tab.panel.open_session(str(studio.recordings.session))
    yield from _trial_pages(studio)
    yield from _analyses(studio)
    yield from _replay(studio)


def _is_idle(studio: Studio) -> bool:
    tab = studio.window.analysis_tab
    return not (tab.worker.is_busy or tab.reader.is_busy)


def _trial_pages(studio: Studio) -> Iterator[Scene]:
    panel, pages = studio.window.analysis_tab.panel, studio.window.analysis_tab.trial_view
    idle = partial(_is_idle, studio)
    studio.camera.wait(lambda: idle() and panel.model.rowCount() > 0)
    panel.table.selectRow(panel.model.rowCount() // 2 + 1)
    studio.camera.wait(idle)
    for index in range(pages.count()):
        pages.setCurrentIndex(index)
        if pages.currentWidget() is pages.compare:
            panel.table.selectAll()
            pages.compare.button.click()
            studio.camera.wait(idle)
        yield Scene(f"trial-{file_name(pages.tabText(index))}", idle)
    pages.setCurrentIndex(0)


def _analyses(studio: Studio) -> Iterator[Scene]:
    tab, box = studio.window.analysis_tab, studio.window.analysis_tab.panel.run_box
    box.form.fields["iterations"].setValue(FEW_DRAWS)
    for name, method in (("classified", QUICK), ("results", PAPER)):
        box.method.setCurrentText(METHODS[method].name)
        box.run_button.click()
        studio.camera.wait(partial(_is_idle, studio))
        yield Scene(name, lambda: tab.results_view.is_whole)
    results = tab.results_view
    for index in range(1, results.count()):
        results.setCurrentIndex(index)
        yield Scene(f"results-{file_name(results.tabText(index))}", lambda: results.is_whole)


def _replay(studio: Studio) -> Iterator[Scene]:
    window, page = studio.window, studio.window.replay.page
    window.replay.show()
    page.open(str(studio.recordings.session))
    studio.camera.wait(lambda: not page.worker.is_busy and page.play.isEnabled())
    page.play.click()
    studio.camera.wait(lambda: page.player.position > REPLAYED_MS)
    page.play.click()
    yield Scene("replay", lambda: not page.worker.is_busy)
    window.replay.hide()
