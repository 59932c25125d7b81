"""The window: panels around the live views, wired to one engine and one analysis process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import QElapsedTimer, Qt, QTimer
from PySide6.QtGui import QAction, QActionGroup, QCloseEvent
from PySide6.QtWidgets import (
    QApplication,
    QHBoxLayout,
    QMainWindow,
    QScrollArea,
    QSplitter,
    QStackedWidget,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from gui.analysis.analysis_tab import AnalysisTab
from gui.engine_link import EngineLink, Opener, open_engine
from gui.live.health import HealthStrip
from gui.live.live_plots import LivePlots
from gui.operate.event_log import BAD_KINDS, EventLog
from gui.operate.operate_panel import OperatePanel
from gui.operate.prompt import PromptPanel
from gui.operate.stop_engines import EngineStopper
from gui.operate.toolbar import Toolbar
from gui.protocol.planner import Planner
from gui.protocol.protocol_panel import ProtocolPanel
from gui.widgets import theme as themes
from gui.widgets.file_browser import FileBrowser, Pick
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.stop_key import StopKey
from gui.widgets.theme import ThemeChoice
from rigctl.acquisition.health.notices import wiring_notice
from rigctl.acquisition.rpc.messages import EngineStatus

FRAME_MS = 33
BAD_STAYS_MS = 8000
TABS_PX = 316
SPANS_S = (2, 5, 10)


class MainWindow(QMainWindow):
    """One rig, seen and worked. ``open_client`` starts or joins an engine for a rig."""

    def __init__(
        self, open_client: Opener = open_engine, choice: ThemeChoice = ThemeChoice.SYSTEM
    ) -> None:
        super().__init__()
        self.setWindowTitle("rigctl")
        self._choice = choice
        self.theme = self._dress()
        self.connection, self.stopper = EngineLink(open_client), EngineStopper()
        self._since_trial = QElapsedTimer()
        self._bad_said = QElapsedTimer()
        self._committed = 0
        self._silent = False
        self._make_parts()
        self._lay_out()
        self._make_menus()
        self._wire_engine()
        self._wire_panels()
        self._stop_key = StopKey(self, self.stop)
        self.timer = QTimer(self)
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(self.tick)
        self.timer.start(FRAME_MS)

    def tick(self) -> None:
        """Thirty times a second: take what the engine said, draw what is new."""
        self.connection.poll()
        self.stopper.poll()
        self.analysis.worker.poll()
        self.planner.worker.poll()
        live = self.connection.live
        if live is not None and self.centre.currentWidget() is self.scene:
            self.scene.refresh(live)

    def stop(self) -> None:
        """Stop whatever runs: this window's rig first, then all others. Never asks, never waits."""
        self.say("stop", "STOP")
        if self.connection.is_open:
            self.connection.ask("stop")
        self.stopper.stop(self.connection.engines)

    def say(self, kind: str, text: str) -> None:
        """Put a sentence into the log and the status line, where bad news stay for a while."""
        self.log.add(kind, text)
        bad = kind in BAD_KINDS
        if not bad and self._bad_said.isValid() and not self._bad_said.hasExpired(BAD_STAYS_MS):
            return
        if bad:
            self._bad_said.start()
        show_text(self.sentence, text)
        set_property(self.sentence, "role", "bad" if bad else "muted")

    def set_theme(self, choice: ThemeChoice) -> None:
        """Take other colours."""
        self._choice = choice
        self.theme = self._dress()
        parts = (self.toolbar, self.health, self.prompt, self.scene, self.log)
        for part in parts:
            part.set_theme(self.theme)
        self.analysis.trial_view.set_theme(self.theme)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Leave the engine and end the analysis process; a run that goes on goes on."""
        self.timer.stop()
        self.analysis.worker.cancel()
        self.planner.worker.cancel()
        self.connection.close()
        self.connection.wait_closed()
        self.stopper.wait()
        super().closeEvent(event)

    def _dress(self) -> themes.Theme:
        """Give the application the chosen colours."""
        theme = themes.chosen(self._choice)
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        themes.apply(app, theme)
        return theme

    def _make_parts(self) -> None:
        self.toolbar, self.health = Toolbar(self.theme), HealthStrip(self.theme)
        self.prompt, self.log = PromptPanel(self.theme), EventLog(self.theme)
        self.operate, self.protocol = OperatePanel(), ProtocolPanel()
        self.analysis, self.browser = AnalysisTab(self.theme), FileBrowser()
        self.planner, self.scene = Planner(self.protocol), LivePlots(self.theme)
        self.sentence = elastic(label("Choose a rig and press Connect.", "muted"))
        self.health.show_nothing()

    def _lay_out(self) -> None:
        self.tabs = QTabWidget()
        self.tabs.setFixedWidth(TABS_PX)
        for panel, name in (
            (self.operate, "Operate"),
            (self.protocol, "Protocol"),
            (self.analysis.panel, "Analysis"),
        ):
            self.tabs.addTab(_scrolling(panel), name)
        self.centre = QStackedWidget()
        pages: tuple[QWidget, ...] = (self.scene, *self.analysis.pages, self.browser)
        for page in pages:
            self.centre.addWidget(page)
        lower = QSplitter(Qt.Orientation.Vertical)
        lower.addWidget(_beside(self.tabs, self.centre))
        lower.addWidget(self.log)
        lower.setStretchFactor(0, 1)
        lower.setSizes([1000, 84])
        lower.setCollapsible(0, False)
        column = QVBoxLayout()
        column.setContentsMargins(0, 0, 0, 4)
        column.setSpacing(5)
        self._prompt_place = _margin(self.prompt)
        for widget in (self.toolbar, self.health, self._prompt_place):
            column.addWidget(widget)
        column.addWidget(_margin(lower), 1)
        column.addWidget(_margin(self.sentence))
        centre = QWidget()
        centre.setLayout(column)
        self.setCentralWidget(centre)
        self.resize(1280, 800)

    def _make_menus(self) -> None:
        view = self.menuBar().addMenu("&View")
        themes_menu = view.addMenu("&Theme")
        group = QActionGroup(self)
        for choice in ThemeChoice:
            action = themes_menu.addAction(choice.value)
            action.setCheckable(True)
            action.setChecked(choice is self._choice)
            action.triggered.connect(lambda _=False, c=choice: self.set_theme(c))
            group.addAction(action)
        self._make_span_menu(view.addMenu("Time &shown"))
        quit_action = self.menuBar().addMenu("&Window").addAction("&Close")
        quit_action.setShortcut("Ctrl+Q")
        quit_action.triggered.connect(self.close)
        hints = QApplication.styleHints()
        hints.colorSchemeChanged.connect(lambda _: self._follow_system())

    def _make_span_menu(self, menu: Any) -> None:
        group = QActionGroup(self)
        for span_s in SPANS_S:
            action: QAction = menu.addAction(f"{span_s} s")
            action.setCheckable(True)
            action.setChecked(span_s == SPANS_S[-1])
            action.triggered.connect(lambda _=False, s=span_s: self.scene.set_span(s))
            group.addAction(action)

    def _follow_system(self) -> None:
        if self._choice is ThemeChoice.SYSTEM:
            self.set_theme(self._choice)

    def _wire_engine(self) -> None:
        link = self.connection
        link.opened.connect(self._opened)
        link.closed.connect(self._closed)
        link.refused.connect(self._refused)
        link.happened.connect(self._happened)
        link.status_changed.connect(self._status)
        link.silent.connect(self._engine_silent)
        link.stop_unanswered.connect(
            lambda: self.say(
                "stop", "STOP was sent, but the engine does not answer: press the emergency stop"
            )
        )

    def _wire_panels(self) -> None:
        ask = self.connection.ask
        bar, operate, protocol = self.toolbar, self.operate, self.protocol
        bar.connect_asked.connect(self.connect_rig)
        bar.disconnect_asked.connect(self.connection.close)
        bar.rig.file_asked.connect(lambda: self._pick(Pick.RIG_FILE, bar.rig.choose))
        bar.world.file_asked.connect(lambda: self._pick(Pick.WORLD_FILE, bar.world.choose))
        bar.stop_asked.connect(self.stop)
        operate.asked.connect(lambda command: ask(command))
        operate.set_asked.connect(lambda v, f: ask("set", speed_mm_s=v, force_g=f))
        operate.jog.asked.connect(self._jog)
        operate.plate_asked.connect(lambda texture: ask("plate", texture=texture))
        operate.inject_asked.connect(lambda fault, args: ask("inject", fault=fault, **args))
        protocol.asked.connect(lambda command: ask(command))
        protocol.start_asked.connect(
            lambda path, out, seed: ask("start", protocol=path, out=out, seed=seed, yes=False)
        )
        protocol.session_asked.connect(lambda: self._pick(Pick.INTERRUPTED, self._go_on))
        protocol.file_asked.connect(lambda: self._pick(Pick.PROTOCOL, protocol.add_protocol))
        protocol.folder_asked.connect(lambda: self._pick(Pick.OUTPUT, protocol.set_out))
        self.prompt.answered.connect(
            lambda number, answer: ask("answer", prompt_id=number, answer=answer)
        )
        self.stopper.said.connect(self.say)
        desk = self.analysis
        desk.said.connect(self.say)
        desk.page_changed.connect(self._show_page)
        desk.panel.browse_asked.connect(lambda: self._pick(Pick.SESSION, desk.panel.choose))
        box = desk.panel.box
        box.form.session_asked.connect(lambda: self._pick(Pick.SESSION, box.form.add_session))
        box.form.c_asked.connect(lambda: self._pick(Pick.MODEL, box.form.c.setText))
        box.model_asked.connect(lambda: self._pick(Pick.MODEL, box.model.setText))
        self.tabs.currentChanged.connect(lambda _: self._show_page())
        self.browser.closed.connect(self._show_page)

    def connect_rig(self, rig: str, world: str = "") -> None:
        """Start or join the engine of a rig; a simulated one in the world of a file."""
        self.toolbar.rig.choose(rig)
        self.toolbar.world.choose(world)
        self.toolbar.show_connecting(rig)
        self.say("rig", f"connecting to {rig}{f' in {world}' if world else ''} …")
        if notice := wiring_notice(rig):
            self.say("check", notice)
        self.connection.open(rig, world)

    def _jog(self, mm: float) -> None:
        jog = self.operate.jog
        self.connection.ask("jog", done=lambda _: jog.ended(), mm=mm)

    def _go_on(self, folder: str) -> None:
        self.connection.ask("start", resume=folder, yes=False)

    def _opened(self) -> None:
        self._committed, self._silent = 0, False
        self._since_trial.invalidate()
        self.scene.forget()
        self.toolbar.show_connected()
        self.say("rig", "connected")

    def _closed(self, sentence: str) -> None:
        self.setWindowTitle("rigctl")
        self.toolbar.show_disconnected(sentence)
        self.health.show_nothing()
        self.operate.show_nothing()
        self.operate.jog.ended()
        self.protocol.show_status(EngineStatus())
        self.prompt.show_prompt(None)
        self.say("rig" if sentence == "not connected" else "lost", sentence)

    def _refused(self, command: str, sentence: str) -> None:
        if command == "jog":
            self.operate.jog.ended()
        self.say("refused", f"{command.replace('_', ' ')}: {sentence}")

    def _happened(self, message: dict[str, Any]) -> None:
        if text := str(message.get("text") or ""):
            self.say(str(message.get("event")), text)

    def _status(self, status: EngineStatus) -> None:
        self._silent = False
        if status.run.trials_committed > self._committed:
            self._since_trial.start()
        self._committed = status.run.trials_committed
        known = self._since_trial.isValid()
        since_s = self._since_trial.elapsed() / 1000 if known else None
        self.setWindowTitle(f"rigctl: {status.rig}{', simulated' if status.simulated else ''}")
        self.toolbar.show_status(status)
        self.health.show_status(status, since_s)
        self.operate.show_status(status)
        self.protocol.show_status(status)
        self.prompt.show_prompt(status.run.prompt)

    def _engine_silent(self, seconds: float) -> None:
        self.toolbar.show_silent(seconds)
        if not self._silent:
            self._silent = True
            self.health.show_nothing()
            self.say("lost", "the engine does not answer: press the emergency stop if it moves")

    def _pick(self, pick: Pick, done: Any) -> None:
        self.browser.ask(pick, Path.home(), done)
        self.centre.setCurrentWidget(self.browser)

    def _show_page(self) -> None:
        analysing = self.tabs.currentIndex() == 2
        self.centre.setCurrentWidget(self.analysis.page if analysing else self.scene)


def _scrolling(panel: QWidget) -> QScrollArea:
    """A tab that scrolls where the screen is too low for it."""
    area = QScrollArea()
    area.setWidget(panel)
    area.setWidgetResizable(True)
    area.setFrameShape(QScrollArea.Shape.NoFrame)
    area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    return area


def _beside(left: QWidget, right: QWidget) -> QWidget:
    both = QWidget()
    row = QHBoxLayout(both)
    row.setContentsMargins(0, 0, 0, 0)
    row.addWidget(left)
    row.addWidget(right, 1)
    return both


def _margin(widget: QWidget) -> QWidget:
    framed = QWidget()
    row = QVBoxLayout(framed)
    row.setContentsMargins(8, 0, 8, 0)
    row.addWidget(widget)
    return framed
