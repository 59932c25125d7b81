"""The pages of the Tools menu: accept a rig, list the serial ports."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.engine_link import EngineLink
from gui.shell.actions import ActionRegistry
from gui.shell.page_stack import PageStack
from gui.tools.accept_page import AcceptPage
from gui.tools.ports_page import PortsPage
from rigctl.acquisition.live_buffer import LiveReader
from rigctl.acquisition.rpc.messages import EngineStatus

IN_USE = "The window uses the boards: disconnect first, because listing the ports resets them."


class ToolsController(QObject):
    """Adds the pages to the window and ends their commands when it closes."""

    path_requested = Signal(object, object)
    closed = Signal()
    """The user has closed a page."""

    def __init__(
        self, stack: PageStack, menus: ActionRegistry, link: EngineLink[EngineStatus, LiveReader]
    ) -> None:
        super().__init__()
        self._stack, self._link = stack, link
        self.accept_page, self.ports_page = AcceptPage(), PortsPage(self._ports_refusal)
        self.accept_page.path_requested.connect(self._choose_path)
        tip = "Judge a rig by a session of the acceptance protocol"
        pages = (
            ("accept", self.accept_page, "&Accept a rig", tip),
            ("ports", self.ports_page, "&Serial ports", "List the ports and the board on each"),
        )
        for name, page, text, tooltip in pages:
            stack.add_page(name, page)
            page.closed.connect(self.closed)
            menus.add("Tools", text, lambda name=name: stack.show_page(name), tip=tooltip)

    def close(self) -> None:
        """End the commands that still run."""
        for page in (self.accept_page, self.ports_page):
            page.close_process()

    def _choose_path(self, kind: object, selected: object) -> None:
        """Let the user choose a file, and come back to the page."""
        assert callable(selected)

        def take(path: str) -> None:
            selected(path)
            self._stack.show_page("accept")

        self.path_requested.emit(kind, take)

    def _ports_refusal(self) -> str:
        uses_boards = self._link.is_connected and not self._link.status.simulated
        return IN_USE if uses_boards else ""
