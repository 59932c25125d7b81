"""The drum rig in the window: its link, its panels, and what passes between them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from PySide6.QtCore import QElapsedTimer, QObject, Signal

from gui.link.engine_link import NOT_CONNECTED, ClientFactory, EngineLink, another_on, shown_rig
from gui.live.health import HealthStrip
from gui.live.live_page import LivePage
from gui.operate.alarms import AlarmCenter
from gui.operate.connection_bar import Toolbar
from gui.operate.event_log import action_name, action_result
from gui.operate.operate_panel import OperatePanel, PromptPanel
from gui.protocol.protocol_panel import ProtocolPanel
from gui.widgets.data_ages import DataAges, data_ages
from gui.widgets.plates import World, world_of
from gui.widgets.theme import Theme
from rigctl.engine.live_file import LiveReader
from rigctl.engine.rpc.messages import EngineStatus, QueueStatus, parse_status

ENGINE_SILENT = "the engine does not answer: press the emergency stop if the drum moves"


class DrumController(QObject):
    """Makes the drum's panels and connects them to its engine."""

    reported = Signal(str, str)
    """Kind and text for the event log."""
    title_changed = Signal(str)
    """The window's title: the connected rig."""

    def __init__(self, theme: Theme, factory: ClientFactory) -> None:
        super().__init__()
        self.link = EngineLink(factory, parse_status, LiveReader)
        self.toolbar, self.health_strip, self.prompt_panel = Toolbar(), HealthStrip(), PromptPanel()
        self.operate_panel, self.protocol_panel = OperatePanel(), ProtocolPanel()
        self.live_page = LivePage(theme)
        self.alarms = AlarmCenter()
        self._is_connected, self._since_status = False, QElapsedTimer()
        self._connected_views = (self.toolbar, self.health_strip, self.operate_panel)
        """Views that show nothing without an engine; the plots keep the last data."""
        self._status = EngineStatus()
        self._title, self.alarm = "rigctl", ""
        self._is_silent = False
        self._connect_engine()
        self._connect_panels()

    def poll(self) -> None:
        """Process messages; take the live data, and draw them while the plots are visible."""
        self.link.poll()
        self._show_ages()
        if self.link.live is not None:
            self.live_page.refresh_slowly(self.link.live)

    def connect_rig(self, rig: str, world: str = "") -> None:
        """Start or join the engine of a rig; a world file is for a simulated rig."""
        self.toolbar.rig.choose(shown_rig(rig))
        self.toolbar.world.choose(world)
        self.toolbar.show_connecting()
        with_world = f" with world {world}" if world else ""
        self.reported.emit("rig", f"connecting to {shown_rig(rig)}{with_world} …")
        self.link.open(rig, world)

    def start_another(self) -> None:
        """Start another engine on the chosen simulated rig, beside those that run."""
        self.connect_rig(another_on(self.toolbar.rig.currentData()), self.toolbar.chosen_world)

    def close(self) -> None:
        """Leave the engine, which continues a run, and end the worker processes."""
        self.protocol_panel.close_workers()
        self.live_page.close_files()
        self.link.close()

    def _connect_engine(self) -> None:
        link = self.link
        link.opening.connect(self.toolbar.show_opening)
        link.opened.connect(self._on_opened)
        link.closed.connect(self._on_closed)
        link.replied.connect(self.operate_panel.finish_command)
        link.refused.connect(self._on_refused)
        link.answered.connect(self._on_answered)
        link.interrupted.connect(self._on_interrupted)
        link.event_received.connect(self._on_event)
        link.status_changed.connect(self._on_status)
        link.silent.connect(self._on_silent)
        link.reported.connect(self.reported)

    def _connect_panels(self) -> None:
        self.toolbar.connect_requested.connect(self.connect_rig)
        self.toolbar.disconnect_requested.connect(self.link.close)
        self.live_page.reported.connect(self.reported)
        self.protocol_panel.reported.connect(self.reported)
        self.alarms.title_changed.connect(self._show_alarm)
        strip = self.alarms.strip
        for panel in (self.operate_panel, self.protocol_panel, self.prompt_panel, strip):
            panel.command_requested.connect(self._request)

    def _request(self, command: str, args: dict[str, Any]) -> None:
        self.link.request(command, **args)

    def _on_opened(self) -> None:
        self._is_silent = False
        self.live_page.plots.clear_history()
        self.live_page.follow(self.link.live)
        self._since_status.invalidate()
        self.alarms.forget()
        for view in (*self._connected_views, self.live_page.plots):
            view.show_ages(DataAges())
        self.toolbar.show_connected()
        self.reported.emit("rig", "connected")

    def _on_closed(self, reason: str) -> None:
        self._tell_queue(reason)
        self.live_page.follow(None)
        self._show_title("rigctl")
        self.toolbar.show_disconnected(reason)
        self.health_strip.show_nothing()
        self.operate_panel.show_nothing()
        self.protocol_panel.show_status(EngineStatus())
        self.protocol_panel.set_rig("")
        self._set_world(None)
        self.prompt_panel.show_prompt(None)
        was_connected, self._is_connected = self._is_connected, False
        if reason == NOT_CONNECTED:
            self.alarms.forget()
        elif was_connected:
            self.alarms.show_lost(reason)
        if (engine := self.link.lost_engine) is not None:
            self.toolbar.offer_again(engine)
        self.reported.emit("rig" if reason == NOT_CONNECTED else "lost", reason)

    def _tell_queue(self, reason: str) -> None:
        """Say which runs wait in the engine that was left, or are lost with it."""
        names = ", ".join(run.protocol for run in self._status.queue.entries)
        self._status = replace(self._status, queue=QueueStatus())
        if names and reason == NOT_CONNECTED:
            self.reported.emit("run", f"the engine goes on with its queue: {names}")
        elif names:
            self.reported.emit("lost", f"if the engine has ended, so has its queue: {names}")

    def _on_refused(self, command: str, sentence: str) -> None:
        self.operate_panel.finish_command(command)
        self.reported.emit("refused", f"{action_name(command)}: {sentence}")

    def _on_event(self, message: dict[str, Any]) -> None:
        kind, data = str(message.get("event")), message.get("data") or {}
        if text := str(message.get("text") or ""):
            self.reported.emit(kind, text)
            self.live_page.add_event(float(message.get("at_s") or 0.0), kind, text, data)
        if kind == "ready":
            self.protocol_panel.set_rig(str(data.get("rig_toml") or ""))
            self.protocol_panel.form.own.show_asked(data.get("asks") or ())
            self._set_world(world_of(data))
        if kind == "run" and (digest := data.get("digest")):
            self.reported.emit("digest", str(digest))

    def _set_world(self, world: World) -> None:
        """Name and draw the plates of the rig."""
        for part in (self.operate_panel.bench, self.prompt_panel, self.protocol_panel):
            part.set_world(world)

    def _on_status(self, status: EngineStatus) -> None:
        self._is_silent = False
        self._show_title(f"rigctl: {status.rig}{', simulated' if status.simulated else ''}")
        self.toolbar.show_status(status)
        self.health_strip.show_status(status)
        self.live_page.show_status(status)
        self.operate_panel.show_status(status)
        self.protocol_panel.show_status(status)
        self.prompt_panel.show_prompt(status.run.prompt)
        self._status, self._is_connected = status, True
        self._since_status.start()
        self.alarms.show_status(status)
        self._show_ages()

    def _show_ages(self) -> None:
        """Let the ages of the data grow, also after a loss: nothing old looks live."""
        if not self._since_status.isValid():
            return
        ages = data_ages(self._status, self._since_status.elapsed() / 1000)
        views = self._connected_views if self._is_connected else ()
        for view in (self.live_page.plots, *views):
            view.show_ages(ages)

    def _on_silent(self, seconds: float) -> None:
        self.toolbar.show_silent(seconds)
        if not self._is_silent:
            self._is_silent = True
            self.health_strip.show_nothing()
            self.alarms.show_silent()
            self.reported.emit("lost", ENGINE_SILENT)

    def _on_answered(self, command: str, result: dict[str, Any]) -> None:
        if text := action_result(command, result):
            self.reported.emit("done", text)

    def _on_interrupted(self, command: str) -> None:
        self.operate_panel.finish_command(command)
        self.reported.emit("log", f"{action_name(command)}: ended by STOP")

    def _show_title(self, title: str) -> None:
        self._title = title
        self.title_changed.emit(f"{self.alarm} – {title}" if self.alarm else title)

    def _show_alarm(self, alarm: str) -> None:
        """Show the first alarm in the heading and the window's title, where the task bar has it."""
        if alarm != self.alarm:
            self.alarm = alarm
            self.toolbar.show_alarm(is_on=bool(alarm))
            self._show_title(self._title)
