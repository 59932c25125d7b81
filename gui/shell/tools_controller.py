"""The pages of the Tools menu: calibrate or accept a rig, list the serial ports."""

from __future__ import annotations

from functools import partial
from typing import Any

from PySide6.QtCore import QObject, Signal

from gui.link.engine_link import EngineLink
from gui.operate.calibrate import CalibratePage
from gui.setup.boards_box import BoardsBox
from gui.setup.flash_strip import FlashStrip
from gui.setup.setup_page import SetupPage
from gui.shell.actions import ActionRegistry
from gui.shell.command_page import AcceptPage, PortsPage
from gui.shell.page_stack import PageStack
from rigctl.acquisition.live_file import LiveReader
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.devices.identity import offered_flash

UNSAVED = "calibration not saved: {parts}; it is lost unless another window is on the rig"
IN_USE = "The window uses the boards: disconnect first, because asking the ports resets them."


class ToolsController(QObject):
    """Adds the pages to the window and ends their commands when it closes."""

    path_requested = Signal(object, object)
    reported = Signal(str, str)
    connect_requested = Signal(str)
    """The ``rig.toml`` of the boards that were found."""
    closed = Signal()
    """The user has closed a page."""

    def __init__(
        self, stack: PageStack, menus: ActionRegistry, link: EngineLink[EngineStatus, LiveReader]
    ) -> None:
        super().__init__()
        self._stack, self._link = stack, link
        self.flash_strip = FlashStrip()
        self.accept_page, self.ports_page = AcceptPage(), PortsPage(self._ports_refusal)
        self.accept_page.path_requested.connect(partial(self._choose_path, "accept"))
        judge = "Judge a rig by a session of the acceptance protocol"
        pages = (
            ("accept", self.accept_page, "&Accept a rig", judge),
            ("ports", self.ports_page, "&Serial ports", "List the ports and the board on each"),
        )
        self.calibrate_page = CalibratePage()
        stack.add_page("calibrate", self.calibrate_page)
        self.calibrate_page.closed.connect(self.closed)
        show = partial(stack.show_page, "calibrate")
        tip = "Calibrate load cell and force loop, measure the imbalance, identify the taxels"
        menus.add("Tools", "&Calibrate", show, shortcut="Ctrl+Shift+C", tip=tip)
        for name, page, text, tooltip in pages:
            stack.add_page(name, page)
            page.closed.connect(self.closed)
            menus.add("Tools", text, lambda name=name: stack.show_page(name), tip=tooltip)

        self._connect_calibration()
        self._add_setup(menus)

    def show_calibration(self, part: str) -> None:
        """Show a part of the page Calibrate."""
        self.calibrate_page.show_part(part)
        self._stack.show_page("calibrate")

    def show_setup(self) -> None:
        """Show the page Set up."""
        self._stack.show_page("setup")
        self.setup_page.open()

    def close(self) -> None:
        """End the commands that still run."""
        for page in (self.accept_page, self.ports_page):
            page.close_process()
        self.setup_page.boards.worker.close()

    def _connect_calibration(self) -> None:
        link, page = self._link, self.calibrate_page
        page.command_requested.connect(self._request)
        link.status_changed.connect(page.show_status)
        link.closed.connect(lambda _: self._leave_rig())
        link.silent.connect(page.load_cell.show_old)
        link.refused.connect(page.show_refusal)
        link.answered.connect(page.show_answer)

    def _add_setup(self, menus: ActionRegistry) -> None:
        link, page = self._link, SetupPage(BoardsBox(self._ports_refusal))
        self.setup_page, strip = page, self.flash_strip
        page.boards.path_requested.connect(partial(self._choose_path, "setup"))
        page.boards.connect_requested.connect(self.connect_requested)
        page.flash_requested.connect(link.close)
        strip.flash_requested.connect(self._flash)
        link.opened.connect(strip.hide)
        link.closed.connect(self._offer_flash)
        link.event_received.connect(self._take_event)
        self._stack.add_page("setup", page)
        page.closed.connect(self.closed)
        page.command_requested.connect(self._request)
        link.status_changed.connect(page.show_status)
        link.closed.connect(lambda _: page.show_status(EngineStatus()))
        link.refused.connect(page.show_refusal)
        tip = "Check a rig part by part, from its wires to the first trial"
        menus.add("Rig", "Set &up …", self.show_setup, tip=tip)

    def _leave_rig(self) -> None:
        """Say what was measured and not saved, and forget it, as the engine does at its end."""
        if unsaved := self.calibrate_page.unsaved:
            self.reported.emit("check", UNSAVED.format(parts=", ".join(unsaved)))
        self.calibrate_page.show_status(EngineStatus())

    def _request(self, command: str, args: dict[str, Any]) -> None:
        self._link.request(command, **args)

    def _offer_flash(self, reason: str) -> None:
        """Offer to flash the board that a connection failed for."""
        self.flash_strip.hide()
        if offered := offered_flash(reason):
            self.flash_strip.offer(*offered, reason)

    def _take_event(self, message: dict[str, Any]) -> None:
        """Offer to flash a board that answers with another build than this installation brings."""
        data = message.get("data") or {}
        if port := data.get("flash_at"):
            self.flash_strip.offer(str(data["board"]), str(port), str(message.get("text")))

    def _flash(self, board: str, port: str) -> None:
        """Flash a board; a connected rig lets its ports go first."""
        is_connected = self._link.is_connected
        self._link.close()
        self._stack.show_page("setup")
        if is_connected:
            self.setup_page.boards.show_released()
        else:
            self.setup_page.boards.flash(board, port)

    def _choose_path(self, page: str, kind: object, selected: object) -> None:
        """Let the user choose a file, and come back to the page."""
        assert callable(selected)

        def take(path: str) -> None:
            selected(path)
            self._stack.show_page(page)

        self.path_requested.emit(kind, take)

    def _ports_refusal(self) -> str:
        uses_boards = self._link.is_connected and not self._link.status.simulated
        return IN_USE if uses_boards else ""
