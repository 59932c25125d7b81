"""Several rigs in one window: above them a strip with name, state and STOP of each."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import QTimer
from PySide6.QtGui import QAction, QCloseEvent
from PySide6.QtWidgets import QButtonGroup, QFrame, QStackedWidget

from gui.operate.alarms import WAITS
from gui.shell.docks import SteadyFocusWindow
from gui.shell.main_window import MainWindow
from gui.widgets.labels import (
    ElidedLabel,
    Level,
    StatusLamp,
    StopButton,
    plain_tooltip,
    show_text,
)
from gui.widgets.layouts import FlowLayout, container, hbox, push_button, vbox

REFRESH_MS = 100
MOST_RIGS = 6
LEAST_CELL_PX = 440
TOO_MANY = f"a window has at most {MOST_RIGS} rigs: open another window"
NOT_AT_REST = (
    "a rig is added once the others are at rest, lifted and without a run: it keeps the window "
    "busy for a second or two, and STOP with it"
)
LAST_RIG = "this is the last rig of the window: close the window"
STAYS = "a rig leaves the window once it is disconnected and the others are at rest"


class RigCell(QFrame):
    """Name, state and STOP of a rig; the name shows its page."""

    def __init__(self, number: int, window: MainWindow) -> None:
        super().__init__()
        self.setProperty("role", "heading")
        self.setMinimumWidth(LEAST_CELL_PX)
        self.number, self._window = number, window
        self.lamp, self.state, self.stop = StatusLamp(18), ElidedLabel(role="heading"), StopButton()
        self.name = push_button("", lambda: None)
        self.name.setCheckable(True)
        self.stop.pressed.connect(window.stop)
        for button in (self.stop, *window.findChildren(StopButton)):
            button.setText(f"STOP {number}")
            button.setToolTip(f"Stop and lift rig {number} alone; Esc stops all rigs")
        row = hbox(self.lamp, self.name, self.state, self.stop, wide=2, spacing=8)
        row.setContentsMargins(8, 3, 8, 3)
        self.setLayout(row)
        self.refresh()

    def refresh(self) -> None:
        """Show what the rig's own heading has, behind its alarm if there is one."""
        name = f"{self.number} {rig_name(self._window)}"
        if self.name.text() != name:
            self.name.setText(name)
            self.name.setToolTip(plain_tooltip(f"Show {name} (Alt+{self.number})"))
            self.stop.setAccessibleName(f"STOP {name}")
        level, words = rig_state(self._window)
        self.lamp.set_level(level)
        show_text(self.state, words)


def rig_name(window: MainWindow) -> str:
    """Return the rig's file without its ending, of a ``rig.toml`` its folder, or its kind."""
    engine = next((link.engine for link in window.links if link.engine is not None), None)
    path = Path(engine.rig if engine is not None else str(window.toolbar.rig.currentData() or ""))
    if path.suffix != ".toml":
        return path.name
    return path.resolve().parent.name if path.stem in ("rig", "finger") else path.stem


def rig_state(window: MainWindow) -> tuple[Level, str]:
    """Return level and words of a rig's state: its first alarm, else what its heading says."""
    finger = window.finger_tab
    is_finger = finger.link.is_connected and not window.engine_link.is_connected
    bar, link = (finger.bar, finger.link) if is_finger else (window.toolbar, window.engine_link)
    words = f"{bar.state.text()}  {bar.state_words.text()}"
    if window.drum.alarm:
        level = Level.WARN if window.drum.alarm == WAITS else Level.BAD
        return level, f"{window.drum.alarm}  {words}"
    if link.is_unheard:
        return Level.BAD, words
    if not link.is_connected:
        return Level.OFF, words
    levels = {"bad": Level.BAD, "stale": Level.WARN}
    return levels.get(str(bar.state.property("level")), Level.OK), words


class RigsWindow(SteadyFocusWindow):
    """Shows the :class:`~gui.shell.main_window.MainWindow` of each rig as a page.

    The strip stays whatever page is shown. Each STOP stops its rig alone, Esc all of them.
    """

    def __init__(self, first: MainWindow) -> None:
        super().__init__()
        self.windows: list[MainWindow] = first.peers
        self.cells: list[RigCell] = []
        self._names, self._pages, self._row = QButtonGroup(self), QStackedWidget(), FlowLayout()
        self.strip = container(self._row)
        self.setCentralWidget(container(vbox(self.strip, self._pages, tall=1)))
        self.setStyleSheet(first.styleSheet())
        self.setGeometry(first.geometry())
        self.setWindowState(first.windowState())
        self._timer = QTimer(self, interval=REFRESH_MS)
        self._timer.timeout.connect(self._refresh)
        self._timer.start()
        self._take(first)

    def add(self, window: MainWindow) -> None:
        """Add the page of another rig, and show it."""
        self.windows.append(window)
        window.peers = self.windows
        self._take(window)

    def remove(self, window: MainWindow) -> None:
        """Close the page of a rig; the others keep their numbers.

        It stays unseen until the end: what listens to the whole program still refers to it.
        """
        cell = self.cells.pop(self.windows.index(window))
        self.windows.remove(window)
        cell.deleteLater()
        self._pages.removeWidget(window)
        window.close()
        self.show_rig(self.windows[0])

    def show_rig(self, window: MainWindow) -> None:
        """Show the page of a rig."""
        self._pages.setCurrentWidget(window)
        self.cells[self.windows.index(window)].name.setChecked(True)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Close all pages, unless one of them asks what becomes of its run: show that."""
        asking = [window for window in self.windows if not window.may_close()]
        if asking:
            self.show_rig(asking[0])
            event.ignore()
            return
        self._timer.stop()
        self.hide()
        for window in self.windows:
            window.close()
        super().closeEvent(event)

    def _take(self, window: MainWindow) -> None:
        """Take a window as a page."""
        free = set(range(1, MOST_RIGS + 1)) - {cell.number for cell in self.cells}
        cell = RigCell(min(free), window)
        cell.name.clicked.connect(partial(self.show_rig, window))
        self.cells.append(cell)
        self._names.addButton(cell.name)
        self._row.addWidget(cell)
        by_key = QAction(cell)
        by_key.setShortcut(f"Alt+{cell.number}")
        by_key.triggered.connect(cell.name.click)
        self.addAction(by_key)
        window.menuBar().setNativeMenuBar(False)
        window.setStyleSheet("")  # that of this window
        window.regions.add(self.strip)
        self._pages.addWidget(window)
        self.show_rig(window)

    def _refresh(self) -> None:
        for cell in self.cells:
            cell.refresh()
        self.setWindowTitle(" | ".join(window.windowTitle() for window in self.windows))


def add_rig(window: MainWindow) -> None:
    """Show a further rig beside those of a window, unless one of them is not at rest."""
    if len(window.peers) == MOST_RIGS or not window.is_at_rest():
        window.report("refused", TOO_MANY if len(window.peers) == MOST_RIGS else NOT_AT_REST)
        return
    further = window.another()
    rigs = window.window()
    if not isinstance(rigs, RigsWindow):
        rigs = RigsWindow(window)
        rigs.show()
    rigs.add(further)
    further.prepare()
    connect_menu(further)


def remove_rig(window: MainWindow) -> None:
    """Close a rig's page, unless it is connected, another one moves, or it is the only one."""
    rigs = window.window()
    if not isinstance(rigs, RigsWindow) or len(window.peers) == 1:
        window.report("refused", LAST_RIG)
    elif any(link.is_connected for link in window.links) or not window.is_at_rest():
        window.report("refused", STAYS)
    else:
        rigs.remove(window)


def connect_menu(window: MainWindow) -> None:
    """Let the menu of a window add rigs to it and remove them."""
    window.rig_wanted.connect(partial(add_rig, window))
    window.rig_unwanted.connect(partial(remove_rig, window))
