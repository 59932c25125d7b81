"""The start page: shown at the first start, and by the Help menu."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.operate.toolbar import Toolbar
from gui.shell.actions import ActionRegistry
from gui.shell.page_stack import PageStack
from gui.start.start_page import StartPage

CONNECTED = "the virtual rig was not started: this window has a rig, disconnect it first"


class StartController(QObject):
    """Adds the page to the window and its action to the Help menu."""

    closed = Signal()
    """The user has closed the page."""
    virtual_requested = Signal(str)
    """Connect to this rig."""
    reported = Signal(str, str)

    def __init__(self, stack: PageStack, menus: ActionRegistry, toolbar: Toolbar) -> None:
        super().__init__()
        self.page, self._stack, self._toolbar = StartPage(), stack, toolbar
        stack.add_page("start", self.page)
        self.page.closed.connect(self.closed)
        self.page.virtual_requested.connect(self._start_virtual)
        menus.add("Help", "S&tart page", self.show, tip="What each panel is for")

    def show(self) -> None:
        """Show the page in the middle of the window."""
        self._stack.setCurrentWidget(self.page)

    def _start_virtual(self) -> None:
        """Connect to the virtual rig, unless the window has a rig or is connecting to one."""
        if self._toolbar.rig.isEnabled():
            self.virtual_requested.emit("virtual")
        else:
            self.reported.emit("refused", CONNECTED)
