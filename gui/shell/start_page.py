"""The start page: shown at the first start, and by the Help menu."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QFormLayout, QWidget

from gui.operate.connection_bar import Toolbar
from gui.shell.actions import ActionRegistry
from gui.shell.page_stack import PageStack
from gui.shell.sample_maker import SampleBox, SampleMaker
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label
from gui.widgets.layouts import container, form_layout, push_button, scroll_area, vbox
from rigctl.synth.sample_session import CHECKING

PANELS = {
    "Operate": "Connect a rig, then move the drum by hand at a speed (mm/s) and a force (g).",
    "Protocol": "Choose or write a protocol, see how long it takes, run it into a session.",
    "Analysis": "Open sessions: look at their trials, compare conditions, classify textures.",
    "Finger": "Slide the sensor over a plate, and see the texture named while it moves.",
    "Replay": "In the menu File: play recorded trials in the live views, at any speed.",
    "Calibrate": "In the menu Tools: load cell, force loop, imbalance and order of the taxels.",
    "Tools": "In the menu: accept a rig by its acceptance session, list the serial ports.",
}
SAMPLE = "Open the sample session"
SAMPLE_TIP = "Needs no hardware: a simulated recording to look at, made the first time"
HINT = (
    "The virtual rig simulates drum, sensor and plates. The sample session is a recording of "
    "32 trials at such a bench, made once and kept. Neither needs hardware."
)


class StartPage(QWidget):
    """Stands in the middle of a window that was never used before."""

    virtual_requested = Signal()
    sample_requested = Signal()
    session_requested = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.virtual = push_button(
            "Start the virtual rig", self.virtual_requested.emit, "Needs no hardware"
        )
        self.sample = push_button(SAMPLE, self.sample_requested.emit, SAMPLE_TIP)
        self.session = push_button(
            "Open a session …", self.session_requested.emit, "Choose the folder of a recording"
        )
        self.back = push_button("Close", self.closed.emit, "Help → Start page shows it again")
        self.sample_box = SampleBox()
        title, hint = label("Welcome to rigctl", "state"), label(HINT, "muted", wraps=True)
        buttons = FlowLayout(self.virtual, self.sample, self.session, self.back)
        rows = (title, _panel_lines(), hint, buttons, self.sample_box)
        column = vbox(*rows, spacing=14, margins=(18, 14, 18, 14))
        column.addStretch(1)
        self.setLayout(vbox(scroll_area(container(column))))


def _panel_lines() -> QFormLayout:
    form = form_layout(10)
    for name, purpose in PANELS.items():
        form.addRow(label(name, "heading"), label(purpose, wraps=True))
    return form


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
