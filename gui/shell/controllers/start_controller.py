"""The start page: shown at the first start, and by the Help menu."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.operate.toolbar import Toolbar
from gui.shell.actions import ActionRegistry
from gui.shell.page_stack import PageStack
from gui.start.sample_maker import SampleMaker
from gui.start.start_page import SAMPLE, SAMPLE_TIP, StartPage
from rigctl.synth.sample_session import CHECKING

READY = f"the sample session is ready: File → {SAMPLE} opens it"
CONNECTED = "the virtual rig was not started: this window has a rig, disconnect it first"


class StartController(QObject):
    """Adds the page to the window and its actions to the menus, and makes the sample session."""

    closed = Signal()
    """The user has closed the page."""
    virtual_requested = Signal(str)
    """Connect to this rig."""
    session_requested = Signal(str)
    """Open this session."""
    reported = Signal(str, str)

    def __init__(self, stack: PageStack, menus: ActionRegistry, toolbar: Toolbar) -> None:
        super().__init__()
        self.page, self.maker = StartPage(), SampleMaker()
        self._stack, self._toolbar = stack, toolbar
        stack.add_page("start", self.page)
        self.page.closed.connect(self.closed)
        self.page.virtual_requested.connect(self._start_virtual)
        self._connect_sample()
        menus.add("File", SAMPLE.replace("sample", "&sample"), self.open_sample, tip=SAMPLE_TIP)
        menus.add("Help", "S&tart page", self.show, tip="What each panel is for")

    def show(self) -> None:
        """Show the page in the middle of the window."""
        if not self.maker.is_busy and not self._is_shown:
            self.page.sample_box.clear()
        self._stack.setCurrentWidget(self.page)

    def open_sample(self) -> None:
        """Open the sample session, which is made where there is no whole one."""
        self.show()
        if not self.maker.is_busy:
            self.page.sample.setEnabled(False)
            self.page.sample_box.show_progress(CHECKING, "")
            self.maker.start()

    def close(self) -> None:
        """End the making of a sample session."""
        self.maker.close()

    @property
    def _is_shown(self) -> bool:
        return self._stack.currentWidget() is self.page

    def _connect_sample(self) -> None:
        page, box, maker = self.page, self.page.sample_box, self.maker
        page.sample_requested.connect(self.open_sample)
        box.cancel_requested.connect(maker.cancel)
        maker.told.connect(box.show_progress)
        maker.remarked.connect(lambda remark: self.reported.emit("check", remark))
        maker.ready.connect(self._open)
        maker.cancelled.connect(box.show_cancelled)
        maker.failed.connect(self._fail)
        for ended in (maker.ready, maker.cancelled, maker.failed):
            ended.connect(lambda *_: page.sample.setEnabled(True))

    def _open(self, session: str) -> None:
        """Open the session, unless the user has gone on to something else meanwhile."""
        self.page.sample_box.clear()
        if self._is_shown:
            self.session_requested.emit(session)
            self.closed.emit()
        else:
            self.reported.emit("analysis", READY)

    def _fail(self, sentence: str) -> None:
        self.page.sample_box.show_failure(sentence)
        self.reported.emit("refused", f"the sample session was not made: {sentence}")

    def _start_virtual(self) -> None:
        """Connect to the virtual rig, unless the window has a rig or is connecting to one."""
        if self._toolbar.rig.isEnabled():
            self.virtual_requested.emit("virtual")
        else:
            self.reported.emit("refused", CONNECTED)
