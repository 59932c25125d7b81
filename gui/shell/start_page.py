"""The start page: shown at the first start, and by the Help menu."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QElapsedTimer, QObject, QTimer, Signal
from PySide6.QtWidgets import QFormLayout, QWidget

from gui.operate.connection_bar import Toolbar
from gui.shell.actions import ActionRegistry
from gui.shell.docks import PageStack
from gui.widgets.background import Background
from gui.widgets.labels import label, set_property
from gui.widgets.layouts import (
    FlowLayout,
    container,
    form_layout,
    hbox,
    push_button,
    scroll_area,
    vbox,
)
from rigctl.synth.sample_session import CHECKING, SYNTH, SampleSession, sample_folder

REMEDY = (
    "Then press the button again. To have one in a folder of your own, use "
    f"rigctl {' '.join(SYNTH)} --out FOLDER and open it here."
)
CANCELLED = "Cancelled: no sample session was made."
CANCELLING = "Cancelling …"
_MS = 1000


class SampleBox(QWidget):
    """A line that counts the seconds of the present stage; hidden while there is nothing to say."""

    cancel_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.text, self.remedy = label(wraps=True), label(REMEDY, wraps=True)
        self.cancel_button = push_button("Cancel", self._cancel, "No sample session is made then")
        self._stage = self._line = ""
        self._is_cancelling = False
        self._since = QElapsedTimer()
        self._timer = QTimer(self, interval=_MS)
        self._timer.timeout.connect(self._count)
        first = hbox(self.cancel_button, self.text, wide=1, spacing=8)
        self.setLayout(vbox(first, self.remedy, spacing=6))
        self.hide()

    def show_progress(self, stage: str, line: str) -> None:
        """Show a stage and the last line of its command, and count the seconds."""
        if self._is_cancelling:
            return
        if stage != self._stage:
            self._since.start()
        self._stage, self._line = stage, line
        self._timer.start()
        self._show("", is_running=True)
        self._count()

    def show_failure(self, sentence: str) -> None:
        """Show why there is no sample session, and what to do."""
        self._end(f"The sample session was not made: {sentence}", "bad")
        self.remedy.show()

    def show_cancelled(self) -> None:
        """Show that there is no sample session, as the user wanted."""
        self._end(CANCELLED, "muted")

    def clear(self) -> None:
        """Say nothing more."""
        self._end("", "")
        self.hide()

    def _cancel(self) -> None:
        self._timer.stop()
        self._is_cancelling = True
        self.cancel_button.setEnabled(False)
        self.text.setText(CANCELLING)
        self.cancel_requested.emit()

    def _count(self) -> None:
        seconds = self._since.elapsed() // _MS
        self.text.setText(f"{self._stage}, {seconds} s{f': {self._line}' if self._line else ' …'}")

    def _end(self, text: str, role: str) -> None:
        self._timer.stop()
        self._stage, self._is_cancelling = "", False
        self._show(role, is_running=False)
        self.text.setText(text)

    def _show(self, role: str, *, is_running: bool) -> None:
        set_property(self.text, "role", role)
        self.cancel_button.setVisible(is_running)
        self.cancel_button.setEnabled(is_running)
        self.remedy.hide()
        self.show()


_CLOSE_TIMEOUT_S = 10.0


class SampleMaker(QObject):
    """Provides one sample session at a time; :meth:`start` does nothing while it is busy."""

    told = Signal(str, str)
    """The present stage, and the last line that its command printed."""
    remarked = Signal(str)
    """What happened to a damaged one, before :attr:`ready`."""
    ready = Signal(str)
    """The folder of a whole session."""
    cancelled = Signal()
    """The command has ended, and what it made is gone."""
    failed = Signal(str)
    """One sentence."""

    def __init__(self) -> None:
        super().__init__()
        self._sample: SampleSession | None = None
        self._background = Background("rigctl-sample-session")

    @property
    def is_busy(self) -> bool:
        """Whether a session is being checked or made."""
        return self._sample is not None

    def start(self) -> None:
        """Check the sample session and make it if need be; a signal tells how that ended."""
        if self._sample is None:
            self._sample = SampleSession(sample_folder(), self.told.emit)
            self._background.run(self._sample.provide, self._end, partial(self._end, False))

    def cancel(self) -> None:
        """End the command; :attr:`cancelled` follows once it has ended."""
        if self._sample is not None:
            self._sample.cancel()

    def close(self) -> None:
        """End the command, and wait until what it has made is gone."""
        self.cancel()
        self._background.close(_CLOSE_TIMEOUT_S)

    def _end(self, is_ready: bool, sentence: str = "") -> None:
        sample, self._sample = self._sample, None
        assert sample is not None
        if sample.remark:
            self.remarked.emit(sample.remark)
        if is_ready:
            self.ready.emit(str(sample.folder))
        elif sentence:
            self.failed.emit(sentence)
        else:
            self.cancelled.emit()


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


def _panel_lines() -> QFormLayout:
    form = form_layout(10)
    for name, purpose in PANELS.items():
        form.addRow(label(name, "heading"), label(purpose, wraps=True))
    return form


READY = f"the sample session is ready: File → {SAMPLE} opens it"
CONNECTED = "the virtual rig was not started: this window has a rig, disconnect it first"


class StartPage(QWidget):
    """Stands in the middle of a window that was never used before; makes the sample session."""

    closed = Signal()
    """The user has closed the page."""
    virtual_requested = Signal(str)
    """Connect to this rig."""
    session_requested = Signal(str)
    """Open this session."""
    browse_requested = Signal()
    """Let the user choose a session to open."""
    sessions_requested = Signal()
    """List the sessions of the data folder."""
    reported = Signal(str, str)

    def __init__(self, stack: PageStack, menus: ActionRegistry, toolbar: Toolbar) -> None:
        super().__init__()
        self.maker = SampleMaker()
        self._stack, self._toolbar = stack, toolbar
        stack.add_page("start", self)
        self._lay_out()
        self._connect_sample()
        menus.add("File", SAMPLE.replace("sample", "&sample"), self.open_sample, tip=SAMPLE_TIP)
        menus.add("Help", "S&tart page", self.show_page, tip="What each panel is for")

    def show_page(self) -> None:
        """Show the page in the middle of the window."""
        if not self.maker.is_busy and not self._is_shown:
            self.sample_box.clear()
        self._stack.setCurrentWidget(self)

    def open_sample(self) -> None:
        """Open the sample session, which is made where there is no whole one."""
        self.show_page()
        if not self.maker.is_busy:
            self.sample.setEnabled(False)
            self.sample_box.show_progress(CHECKING, "")
            self.maker.start()

    @property
    def _is_shown(self) -> bool:
        return self._stack.currentWidget() is self

    def _lay_out(self) -> None:
        tip = "Needs no hardware"
        self.virtual = push_button("Start the virtual rig", self._start_virtual, tip)
        self.sample = push_button(SAMPLE, self.open_sample, SAMPLE_TIP)
        tip = "Choose the folder of a recording"
        self.session = push_button("Open a session …", self.browse_requested.emit, tip)
        tip = "All recordings below the data folder, with filter and search"
        self.sessions = push_button("List the sessions", self.sessions_requested.emit, tip)
        self.back = push_button("Close", self.closed.emit, "Help → Start page shows it again")
        self.sample_box = SampleBox()
        title, hint = label("Welcome to rigctl", "state"), label(HINT, "muted", wraps=True)
        buttons = FlowLayout(self.virtual, self.sample, self.session, self.sessions, self.back)
        rows = (title, _panel_lines(), hint, buttons, self.sample_box)
        column = vbox(*rows, spacing=14, margins=(18, 14, 18, 14), tall=-1)
        self.setLayout(vbox(scroll_area(container(column))))

    def _connect_sample(self) -> None:
        box, maker = self.sample_box, self.maker
        box.cancel_requested.connect(maker.cancel)
        maker.told.connect(box.show_progress)
        maker.remarked.connect(lambda remark: self.reported.emit("check", remark))
        maker.ready.connect(self._open)
        maker.cancelled.connect(box.show_cancelled)
        maker.failed.connect(self._fail)
        for ended in (maker.ready, maker.cancelled, maker.failed):
            ended.connect(lambda *_: self.sample.setEnabled(True))

    def _open(self, session: str) -> None:
        """Open the session, unless the user has gone on to something else meanwhile."""
        self.sample_box.clear()
        if self._is_shown:
            self.session_requested.emit(session)
            self.closed.emit()
        else:
            self.reported.emit("analysis", READY)

    def _fail(self, sentence: str) -> None:
        self.sample_box.show_failure(sentence)
        self.reported.emit("refused", f"the sample session was not made: {sentence}")

    def _start_virtual(self) -> None:
        """Connect to the virtual rig, unless the window has a rig or is connecting to one."""
        if self._toolbar.rig.isEnabled():
            self.virtual_requested.emit("virtual")
        else:
            self.reported.emit("refused", CONNECTED)
