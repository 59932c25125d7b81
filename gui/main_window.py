"""The main window: panels around the live plots, connected to one engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QActionGroup, QCloseEvent, QKeyEvent
from PySide6.QtWidgets import (
    QApplication,
    QMainWindow,
    QMenu,
    QSplitter,
    QStackedWidget,
    QTabWidget,
    QWidget,
)

from gui.analysis.analysis_tab import AnalysisTab
from gui.engine_clients import open_client, open_finger_client
from gui.engine_link import DRUM, NOT_CONNECTED, ClientFactory, EngineLink
from gui.finger.finger_tab import FingerTab
from gui.live.health import HealthStrip
from gui.live.live_plots import LivePlots
from gui.operate.event_log import EventLog, StatusLine
from gui.operate.operate_panel import OperatePanel
from gui.operate.prompt import PromptPanel
from gui.operate.toolbar import Toolbar
from gui.protocol.protocol_panel import ProtocolPanel
from gui.widgets.file_browser import FileBrowser, PathKind
from gui.widgets.layouts import container, hbox, scroll_area, vbox
from gui.widgets.theme import ThemeChoice, apply_theme
from rigctl.acquisition.health.notices import wiring_notice
from rigctl.acquisition.rpc.messages import EngineStatus

FRAME_MS = 33
TABS_PX = 316
SPANS_S = (2, 5, 10)
ENGINE_SILENT = "the engine does not answer: press the emergency stop if the drum moves"


class MainWindow(QMainWindow):
    """A window on the drum rig and the moving finger.

    ``factory`` and ``finger_factory`` start or join the engines of their rigs.
    """

    def __init__(
        self,
        factory: ClientFactory = open_client,
        choice: ThemeChoice = ThemeChoice.SYSTEM,
        finger_factory: ClientFactory = open_finger_client,
    ) -> None:
        super().__init__()
        self.setWindowTitle("rigctl")
        self._theme_choice = choice
        theme = apply_theme(choice)
        self.engine_link = EngineLink(factory, DRUM)
        self.toolbar, self.health_strip, self.prompt_panel = Toolbar(), HealthStrip(), PromptPanel()
        self.operate_panel, self.protocol_panel = OperatePanel(), ProtocolPanel()
        self.analysis_tab, self.live_plots = AnalysisTab(theme), LivePlots(theme)
        self.finger_tab = FingerTab(theme, finger_factory)
        self.file_browser, self.event_log = FileBrowser(), EventLog()
        self.status_line = StatusLine("Choose a rig and press Connect.")
        self._is_silent = False
        self._lay_out()
        self._add_menus()
        self._connect_engine()
        self._connect_panels()
        app = QApplication.instance()
        assert app is not None
        app.installEventFilter(self)
        self.timer = QTimer(self)
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(self.poll)
        self.timer.start(FRAME_MS)

    def poll(self) -> None:
        """Process the messages of engine and workers, and draw new samples; 30 times a second."""
        self.engine_link.poll()
        self.analysis_tab.worker.poll()
        self.protocol_panel.worker.poll()
        live = self.engine_link.live
        if live is not None and self.stack.currentWidget() is self.live_plots:
            self.live_plots.refresh(live)
        self.finger_tab.poll(is_visible=self.stack.currentWidget() is self.finger_tab.view)

    def connect_rig(self, rig: str, world: str = "") -> None:
        """Start or join the engine of a rig; a world file is for a simulated rig."""
        self.toolbar.rig.choose(rig)
        self.toolbar.world.choose(world)
        self.toolbar.show_connecting()
        self.report("rig", f"connecting to {rig}{f' with world {world}' if world else ''} …")
        if notice := wiring_notice(rig):
            self.report("check", notice)
        self.engine_link.open(rig, world)

    def stop(self) -> None:
        """Stop this window's engines, then all others; never asks and never waits."""
        self.report("stop", "STOP")
        self.engine_link.stop()
        self.finger_tab.link.stop_own()

    def report(self, kind: str, text: str) -> None:
        """Show an event in the log and the status line."""
        self.event_log.add(kind, text)
        self.status_line.show_event(kind, text)

    def set_theme(self, choice: ThemeChoice) -> None:
        """Apply another theme."""
        self._theme_choice = choice
        theme = apply_theme(choice)
        self.live_plots.set_theme(theme)
        self.analysis_tab.trial_view.set_theme(theme)
        self.finger_tab.view.set_theme(theme)
        self.event_log.reset_colours()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Stop on Esc with every focus; an open menu or list still gets the key and closes."""
        if event.type() != QEvent.Type.KeyPress or not isinstance(watched, QWidget):
            return False
        if not isinstance(event, QKeyEvent) or event.key() != Qt.Key.Key_Escape:
            return False
        if not event.isAutoRepeat():
            self.stop()
        return QApplication.activePopupWidget() is None

    def closeEvent(self, event: QCloseEvent) -> None:
        """Leave the engines, which continue a run, and end the worker processes."""
        self.timer.stop()
        self.analysis_tab.worker.cancel()
        self.protocol_panel.worker.cancel()
        self.engine_link.close()
        self.finger_tab.close()
        self.engine_link.wait_closed()
        super().closeEvent(event)

    def _lay_out(self) -> None:
        self.tabs = QTabWidget()
        self.tabs.setFixedWidth(TABS_PX)
        self.tabs.addTab(scroll_area(self.operate_panel), "Operate")
        self.tabs.addTab(scroll_area(self.protocol_panel), "Protocol")
        self._analysis_index = self.tabs.addTab(scroll_area(self.analysis_tab.panel), "Analysis")
        self._finger_index = self.tabs.addTab(scroll_area(self.finger_tab.panel), "Finger")
        self.stack, self.health = QStackedWidget(), QStackedWidget()
        self.toolbar.add_page(self.finger_tab.bar)
        for strip in (self.health_strip, self.finger_tab.health):
            self.health.addWidget(strip)
        views: tuple[QWidget, ...] = (self.finger_tab.view, *self.analysis_tab.views)
        pages: tuple[QWidget, ...] = (self.live_plots, *views, self.file_browser)
        for page in pages:
            self.stack.addWidget(page)
        splitter = QSplitter(Qt.Orientation.Vertical)
        splitter.addWidget(container(hbox(self.tabs, self.stack, wide=1, spacing=6)))
        splitter.addWidget(self.event_log)
        splitter.setStretchFactor(0, 1)
        splitter.setSizes([1000, 84])
        splitter.setCollapsible(0, False)
        prompts = (self.prompt_panel, self.finger_tab.prompt_panel)
        indented = (
            container(vbox(widget, margins=(8, 0, 8, 0)))
            for widget in (*prompts, splitter, self.status_line)
        )
        column = vbox(self.toolbar, self.health, *indented, spacing=5, margins=(0, 0, 0, 4))
        column.setStretch(2 + len(prompts), 1)
        self.setCentralWidget(container(column))
        self.resize(1280, 800)

    def _add_menus(self) -> None:
        view = self.menuBar().addMenu("&View")
        themes = {choice.value: choice for choice in ThemeChoice}
        _add_choices(view.addMenu("&Theme"), themes, self._theme_choice, self.set_theme)
        spans = {f"{span_s} s": span_s for span_s in SPANS_S}
        set_span = self.live_plots.set_span
        _add_choices(view.addMenu("Time &span"), spans, SPANS_S[-1], set_span)
        close = self.menuBar().addMenu("&Window").addAction("&Close")
        close.setShortcut("Ctrl+Q")
        close.triggered.connect(self.close)
        hints = QApplication.styleHints()
        hints.colorSchemeChanged.connect(lambda _: self._follow_system_theme())

    def _follow_system_theme(self) -> None:
        if self._theme_choice is ThemeChoice.SYSTEM:
            self.set_theme(self._theme_choice)

    def _connect_engine(self) -> None:
        link = self.engine_link
        link.opened.connect(self._on_opened)
        link.closed.connect(self._on_closed)
        link.replied.connect(self.operate_panel.finish_command)
        link.refused.connect(self._on_refused)
        link.event_received.connect(self._on_event)
        link.status_changed.connect(self._on_status)
        link.silent.connect(self._on_silent)
        link.stop_reported.connect(self.report)

    def _connect_panels(self) -> None:
        self.toolbar.connect_requested.connect(self.connect_rig)
        self.toolbar.disconnect_requested.connect(self.engine_link.close)
        self.toolbar.stop_requested.connect(self.stop)
        for panel in (self.operate_panel, self.protocol_panel, self.prompt_panel):
            panel.command_requested.connect(self._request)
        boxes = (self.toolbar.rig, self.toolbar.world)
        panels = (self.protocol_panel, self.analysis_tab.panel, self.finger_tab)
        for widget in (*boxes, *panels):
            widget.path_requested.connect(self._browse)
        self.finger_tab.reported.connect(self.report)
        self.analysis_tab.reported.connect(self.report)
        self.analysis_tab.view_changed.connect(self._show_view)
        self.tabs.currentChanged.connect(lambda _: self._show_view())
        self.file_browser.closed.connect(self._show_view)

    def _request(self, command: str, args: dict[str, Any]) -> None:
        self.engine_link.request(command, **args)

    def _browse(self, kind: PathKind, selected: Callable[[str], None]) -> None:
        self.file_browser.open(kind, selected)
        self.stack.setCurrentWidget(self.file_browser)

    def _show_view(self) -> None:
        index = self.tabs.currentIndex()
        is_finger = index == self._finger_index
        views = {
            self._analysis_index: self.analysis_tab.view,
            self._finger_index: self.finger_tab.view,
        }
        self.stack.setCurrentWidget(views.get(index, self.live_plots))
        for pages in (self.toolbar.pages, self.health):
            pages.setCurrentIndex(int(is_finger))

    def _on_opened(self) -> None:
        self._is_silent = False
        self.health_strip.reset()
        self.live_plots.clear_history()
        self.toolbar.show_connected()
        self.report("rig", "connected")

    def _on_closed(self, reason: str) -> None:
        self.setWindowTitle("rigctl")
        self.toolbar.show_disconnected(reason)
        self.health_strip.show_nothing()
        self.operate_panel.show_nothing()
        self.protocol_panel.show_status(EngineStatus())
        self.prompt_panel.show_prompt(None)
        self.report("rig" if reason == NOT_CONNECTED else "lost", reason)

    def _on_refused(self, command: str, sentence: str) -> None:
        self.operate_panel.finish_command(command)
        self.report("refused", f"{command.replace('_', ' ')}: {sentence}")

    def _on_event(self, message: dict[str, Any]) -> None:
        kind, data = str(message.get("event")), message.get("data") or {}
        if text := str(message.get("text") or ""):
            self.report(kind, text)
        if kind == "run" and (digest := data.get("digest")):
            self.event_log.add("digest", str(digest))

    def _on_status(self, status: EngineStatus) -> None:
        self._is_silent = False
        self.setWindowTitle(f"rigctl: {status.rig}{', simulated' if status.simulated else ''}")
        self.toolbar.show_status(status)
        self.health_strip.show_status(status)
        self.live_plots.set_sensor_layout(status.sensor_layout)
        self.operate_panel.show_status(status)
        self.protocol_panel.show_status(status)
        self.prompt_panel.show_prompt(status.run.prompt)

    def _on_silent(self, seconds: float) -> None:
        self.toolbar.show_silent(seconds)
        if not self._is_silent:
            self._is_silent = True
            self.health_strip.show_nothing()
            self.report("lost", ENGINE_SILENT)


def _add_choices(
    menu: QMenu, choices: Mapping[str, Any], checked: Any, chosen: Callable[[Any], object]
) -> None:
    """Add exclusive choices, by their texts, to a menu; ``chosen`` gets the value of one."""
    group = QActionGroup(menu)
    for text, value in choices.items():
        action = group.addAction(menu.addAction(text))
        action.setCheckable(True)
        action.setChecked(value == checked)
        action.triggered.connect(lambda _=False, value=value: chosen(value))
