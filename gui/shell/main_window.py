"""The main window: a heading with STOP, panels in docks around the pages, and the event log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QAction, QCloseEvent, QGuiApplication, QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QApplication,
    QLayout,
    QPushButton,
    QStackedWidget,
    QTableView,
    QWidget,
)

from gui.finger.finger_tab import FingerTab
from gui.link.attach import AttachController, ControlLock, PastLine
from gui.link.engine_link import ClientFactory, joined_rig, open_client, open_finger_client
from gui.live.own_plots import OwnPlots
from gui.operate.event_log import EventLog, LogPanel, StatusLine
from gui.protocol.session_page import RunEndStrip
from gui.shell.actions import ActionRegistry, keys_by_position
from gui.shell.docks import DockArea, PageStack, SteadyFocusWindow, give_focus, neighbour_of
from gui.shell.drum_controller import DrumController
from gui.shell.help_page import REPORTS, HelpPage
from gui.shell.menus import (
    SaveMenu,
    add_alarm_switches,
    add_analysis_menu,
    add_live_actions,
    add_lsl_choices,
    add_panel_menus,
    add_rig_menu,
    drum_controls,
    finger_controls,
)
from gui.shell.replay_controller import ReplayController
from gui.shell.start_page import StartPage
from gui.shell.tools_controller import ToolsController
from gui.shell.user_settings import RecentRigs, RecentSessions, UserSettings, WindowMemory
from gui.widgets.file_browser import FileBrowser, PathKind
from gui.widgets.layouts import container, copy_rows, scroll_area, vbox
from gui.widgets.theme import Theme, ThemeChoice, apply_palette, apply_theme, scale_texts
from rigctl.engine.contact import RESTING_STATES
from rigctl.engine.rpc.engine_files import EngineFile
from rigctl.experiments import FINGER_EXPERIMENT
from rigctl.values import SessionLine

if TYPE_CHECKING:
    from gui.analysis.analysis_tab import AnalysisTab
    from gui.analysis.session_list import SessionList

TEXT_SIZES_PERCENT = (90, 100, 115, 130, 150)
NOT_AT_REST = (
    "theme and text size change once the rig is at rest, lifted and without a run: they keep the "
    "window busy for up to a second, and STOP with it"
)


class Appearance(QObject):
    """Applies theme and text size to the whole program.

    ``theme`` is the theme in use, ``choice`` what the user chose. Plots have colours of their own
    and follow ``theme_changed``. All widgets are styled anew in one piece, and STOP would wait for
    it: choices are refused unless ``is_at_rest``, and a change of the desktop's colours waits.
    """

    theme_changed = Signal(object)
    reported = Signal(str, str)

    def __init__(
        self,
        settings: UserSettings,
        choice: ThemeChoice,
        docks: DockArea,
        is_at_rest: Callable[[], bool],
    ) -> None:
        super().__init__()
        self._settings, self.choice, self._docks = settings, choice, docks
        self._is_at_rest, self._system_changed = is_at_rest, False
        self._themes: dict[Any, QAction] = {}
        self._sizes: dict[Any, QAction] = {}
        scale_texts(self._text_percent() / 100)
        self.theme = apply_palette(choice)
        hints = QApplication.styleHints()
        hints.colorSchemeChanged.connect(lambda _: self._note_system())

    def add_menus(self, menus: ActionRegistry) -> None:
        """Add the choices of theme and text size to the View menu."""
        themes = {choice.value: choice for choice in ThemeChoice}
        self._themes = menus.add_choices("View", "&Theme", themes, self.choice, self._choose_theme)
        sizes = {f"{percent} %": percent for percent in TEXT_SIZES_PERCENT}
        size = self._text_percent()
        self._sizes = menus.add_choices("View", "Te&xt size", sizes, size, self._choose_text_size)

    def apply(self) -> None:
        """Style the widgets, once they are made."""
        apply_theme(self.choice, self._docks.window())

    def set_theme(self, choice: ThemeChoice) -> None:
        """Apply another theme."""
        self.choice = choice
        self.theme = apply_theme(choice, self._docks.window())
        self.theme_changed.emit(self.theme)

    def set_text_size(self, percent: int) -> None:
        """Show all texts larger or smaller, in percent of the usual size."""
        widths_px = self._docks.asked_widths_px()
        self._settings.set_value("text_percent", percent)
        scale_texts(percent / 100)
        self.set_theme(self.choice)
        for layout in self._docks.window().findChildren(QLayout):
            layout.invalidate()  # what is hidden would keep the room of the texts before
        self._docks.follow_texts(widths_px)

    def take(self, other: Appearance) -> None:
        """Mark what was chosen in the page of another rig."""
        self.choice, self.theme = other.choice, other.theme
        self._themes[self.choice].setChecked(True)
        self._sizes[self._text_percent()].setChecked(True)

    def follow_system(self) -> None:
        """Take the desktop's colours, if they have changed, once the rig is at rest."""
        if self._system_changed and self._is_at_rest():
            self._system_changed = False
            if self.choice is ThemeChoice.SYSTEM:
                self.set_theme(self.choice)

    def _choose_theme(self, choice: ThemeChoice) -> None:
        if self._may_change(self._themes[self.choice]):
            self._settings.set_value("theme", choice.name)
            self.set_theme(choice)

    def _choose_text_size(self, percent: int) -> None:
        if self._may_change(self._sizes[self._text_percent()]):
            self.set_text_size(percent)

    def _may_change(self, present: QAction) -> bool:
        """Return whether the rig is at rest; say why not, and mark the present choice again."""
        if self._is_at_rest():
            return True
        present.setChecked(True)
        self.reported.emit("refused", NOT_AT_REST)
        return False

    def _note_system(self) -> None:
        self._system_changed = True
        self.follow_system()

    def _text_percent(self) -> int:
        return self._settings.value("text_percent", 100, TEXT_SIZES_PERCENT.__contains__)


class Regions:
    """Moves the focus into a region: to its first control, so that no Tab leads through all."""

    def __init__(self, heading: QWidget, strips: Sequence[QWidget], docks: DockArea) -> None:
        self._above, self._docks = [heading, *strips], docks

    def add(self, strip: QWidget) -> None:
        """Add a strip above the heading."""
        self._above.insert(0, strip)

    def add_menus(self, menus: ActionRegistry) -> None:
        """Add the keys of regions and panels to the View menu."""
        tip = "Move the keyboard's focus to heading, question, panel, middle or log"
        menus.add("View", "&Next region", partial(self._move, 1), shortcut="F6", tip=tip)
        tip = "Move the keyboard's focus back by one region"
        menus.add("View", "Pre&vious region", partial(self._move, -1), shortcut="Shift+F6", tip=tip)
        for number, (name, dock) in enumerate(self._docks.docks.items(), start=1):
            tip = "Bring this panel to the front, with the keyboard's focus"
            text, keys = dock.windowTitle(), f"Ctrl+{number}"
            menus.add("View", text, lambda name=name: self.show_panel(name), shortcut=keys, tip=tip)
        menus.add("View", "&Reset the layout", self._docks.reset, tip="Put all panels back")

    def show_panel(self, name: str) -> None:
        """Bring a panel to the front and the focus to its first control."""
        self._docks.show_panel(name)
        focus_first(self._docks.docks[name])

    def _move(self, step: int) -> None:
        """Move the focus by regions."""
        regions = self._regions()
        focus = QApplication.focusWidget()
        inside = [n for n, region in enumerate(regions) if focus and region.isAncestorOf(focus)]
        at = inside[0] if inside else (-1 if step > 0 else 0)
        for n in range(1, len(regions) + 1):
            if focus_first(regions[(at + step * n) % len(regions)]):
                return

    def _regions(self) -> list[QWidget]:
        """Return what is on the screen now, from top to bottom."""
        *panels, log = self._docks.docks.values()
        fronts = [dock for dock in panels if not dock.visibleRegion().isEmpty()]
        regions = (*self._above, *fronts, self._docks.centralWidget(), log)
        return [region for region in regions if region is not None and region.isVisible()]


def focus_first(region: QWidget) -> bool:
    """Give the focus to the first control of a region; return whether it has one."""
    first = neighbour_of(region, None)
    if first is None:
        return False
    give_focus(first)
    return True


class KeyFilter(QObject):
    """Reports one press of Esc once; an open menu or list still gets the key and closes.

    Ctrl+C copies the selected rows of a table. Shortcuts work by the places of their keys, too.
    Return presses the button that has the focus, as the space bar does, on every desktop. A rig's
    page that another one hides takes no keys.
    """

    escaped = Signal()

    def __init__(self, window: QWidget, menus: ActionRegistry) -> None:
        super().__init__(window)
        self._window, self._menus = window, menus
        self._is_down = False
        self._app = QApplication.instance()
        assert self._app is not None
        self._app.installEventFilter(self)

    def release(self) -> None:
        """Leave the key to other windows of this process."""
        assert self._app is not None
        self._app.removeEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take the keys before the widget with the focus gets them."""
        is_shown = self._window.isWindow() or self._window.isVisible()
        if not is_shown or not isinstance(event, QKeyEvent):
            return False
        if event.key() in _PRESS_KEYS and event.type() == QEvent.Type.KeyPress:
            return not event.isAutoRepeat() and _click(watched)
        if event.type() == QEvent.Type.KeyPress and event.key() != Qt.Key.Key_Escape:
            return self._take_keys(watched, event)
        if event.key() != Qt.Key.Key_Escape:
            return False
        if event.type() == QEvent.Type.KeyRelease:
            self._is_down = False
        if event.type() != QEvent.Type.KeyPress or not isinstance(watched, QWidget):
            return False
        if not event.isAutoRepeat():
            self._report_once()
        return QApplication.activePopupWidget() is None

    def _take_keys(self, watched: QObject, event: QKeyEvent) -> bool:
        """Copy rows, or do what the keys at these places do; return whether that was all."""
        by_place = keys_by_position(event)
        is_copy = event.matches(QKeySequence.StandardKey.Copy) or by_place == COPY
        if is_copy and isinstance(watched, QTableView):
            copy_rows(watched)
            return True
        action = self._menus.at(by_place) if not by_place.isEmpty() else None
        if action is not None and isinstance(watched, QWidget):
            action.trigger()
        return action is not None

    def _report_once(self) -> None:
        """Report one press once: Qt passes the key of an open list to its parents as well."""
        if not self._is_down:
            self._is_down = True
            QTimer.singleShot(0, self._forget)
            self.escaped.emit()

    def _forget(self) -> None:
        self._is_down = False


def _click(watched: QObject) -> bool:
    """Press a button with the focus; return whether it is one."""
    if not isinstance(watched, QPushButton) or not watched.hasFocus():
        return False
    watched.click()
    return True


CANNOT_CONTINUE = (
    "the session cannot go on now: connect its rig, clear its fault or end its run, then press "
    "Continue again"
)
COPY = QKeySequence("Ctrl+C")
FRAME_MS = 33
_PRESS_KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
WIDTH_PX, HEIGHT_PX = 1280, 800
LEFT_PX, LOG_PX = 330, 88
_LEFT = Qt.DockWidgetArea.LeftDockWidgetArea
_BOTTOM = Qt.DockWidgetArea.BottomDockWidgetArea


class MainWindow(SteadyFocusWindow):
    """A window on the drum rig and the moving finger.

    ``factory`` and ``finger_factory`` start or join the engines of their rigs. Without
    ``settings`` the window remembers nothing. Beside other rigs it is a page of a window.
    """

    rig_wanted = Signal()
    """The user wants a further rig in the same window."""
    rig_unwanted = Signal()
    """The user wants this rig out of a window of several."""

    def __init__(
        self,
        factory: ClientFactory = open_client,
        choice: ThemeChoice = ThemeChoice.SYSTEM,
        finger_factory: ClientFactory = open_finger_client,
        settings: UserSettings | None = None,
    ) -> None:
        super().__init__()
        self.setWindowTitle("rigctl")
        self.peers = [self]
        """The pages of all rigs in the same window, this one among them."""
        self.settings = settings if settings is not None else UserSettings(None)
        self._factories = factory, finger_factory
        self.stack = PageStack()
        self.docks = DockArea(self.stack)
        self.appearance = Appearance(self.settings, choice, self.docks, self.is_at_rest)
        theme = self.appearance.theme
        self.drum = DrumController(theme, factory)
        self.engine_link, self.toolbar = self.drum.link, self.drum.toolbar
        self.health_strip, self.prompt_panel = self.drum.health_strip, self.drum.prompt_panel
        self.operate_panel = self.drum.operate_panel
        self.protocol_panel = self.drum.protocol_panel
        self.live_page, self.live_plots = self.drum.live_page, self.drum.live_page.plots
        self.own_plots = OwnPlots(theme)
        self.finger_tab = FingerTab(theme, finger_factory)
        self.links = (self.engine_link, self.finger_tab.link)
        self.engine_link.spared = self._engines_of_peers
        self.attach = AttachController(self.links)
        self.file_browser, self.event_log = FileBrowser(), EventLog()
        self.status_line = StatusLine("Choose a rig and press Connect.")
        self.run_end_strip = RunEndStrip()
        self.menus = ActionRegistry(self.menuBar())
        self.sessions = RecentSessions(self.menus, self.settings)
        self.replay = ReplayController(theme, self.stack, self.sessions)
        self.replay.author = self._author
        self.replay.place_of = lambda path: self.analysis_tab.panel.run_box.place_of(path)
        self.help = HelpPage(self.menus, self.settings.folder / REPORTS)
        self.start = StartPage(self.stack, self.menus, self.toolbar)
        self.tools = ToolsController(self.stack, self.menus, self.engine_link)
        self._panel = "operate"
        self._lay_out()
        self.appearance.apply()
        self._add_menus()
        self._connect_panels()
        self.memory = WindowMemory(self.settings, self, self.docks)
        self._remember()
        self._keys = KeyFilter(self, self.menus)
        self._keys.escaped.connect(self._escape)
        self.timer = QTimer(self)
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(self.poll)
        self.timer.start(FRAME_MS)

    @cached_property
    def analysis_tab(self) -> AnalysisTab:
        """The Analysis tab, made when it is first wanted, at the latest by :meth:`prepare`.

        The window is there a tenth of a second sooner.
        """
        from gui.analysis.analysis_tab import AnalysisTab

        tab = AnalysisTab(self.appearance.theme)
        tab.author = self._author
        tab.panel.run_box.fallback = self.protocol_panel.out.text
        for name, page in tab.pages.items():
            self.stack.add_page(name, page)
        self._analysis_place.addWidget(scroll_area(tab.panel))
        add_analysis_menu(self.menus, tab, self.docks)
        self.memory.keep_texts({"results_in": tab.panel.run_box.place})
        self.replay.follow_choice(tab.panel)
        tab.panel.path_requested.connect(self._browse)
        tab.reported.connect(self.report)
        tab.view_changed.connect(self._show_view)
        tab.opened.connect(self.sessions.remember)
        tab.found_whole.connect(self._keep_verified)
        self._connect_sessions(tab.sessions)
        return tab

    @property
    def _made_analysis(self) -> list[AnalysisTab]:
        """The tab, if there is one."""
        return [self.analysis_tab] if "analysis_tab" in vars(self) else []

    def _author(self) -> str:
        """Return who writes notes: the operator of the next run."""
        return str(self.protocol_panel.form.people()["operator"])

    def another(self) -> MainWindow:
        """Return the page of another rig, which is not in a window yet."""
        drum, finger = self._factories
        return MainWindow(drum, self.appearance.choice, finger, self.settings)

    def fit_screen(self) -> None:
        """Bring a window whose frame hangs off the screen wholly onto it."""
        window = self.window()
        room, frame = window.screen().availableGeometry(), window.frameGeometry()
        if window.isMaximized() or window.isFullScreen() or room.contains(frame):
            return
        window.resize(window.size().boundedTo(room.size() - (frame.size() - window.size())))
        frame = window.frameGeometry()
        corner = room.bottomRight() - QPoint(frame.width() - 1, frame.height() - 1)
        window.move(
            max(room.left(), min(frame.left(), corner.x())),
            max(room.top(), min(frame.top(), corner.y())),
        )

    def prepare(self) -> None:
        """Make and lay out what is not in view before a rig moves, for later STOP waits for it.

        Qt lays out every hidden page for the first picture of any.
        """
        self.analysis_tab.prepare()
        assert self.replay.page and self.analysis_tab.trial_view.compare.overlaid
        self.grab(QRect(0, 0, 1, 1))

    def poll(self) -> None:
        """Process the messages of the engines, and draw new samples; 30 times a second."""
        page = self.stack.currentWidget()
        self.drum.poll()
        self.replay.poll()
        self.own_plots.poll()
        self.finger_tab.poll(is_visible=page is self.finger_tab.view)

    def connect_rig(self, rig: str, world: str = "") -> None:
        """Start or join the engine of a rig; a world file is for a simulated rig."""
        self.drum.connect_rig(rig, world)

    def join_engine(self, engine: EngineFile) -> None:
        """Join a running engine in the panel of its experiment."""
        is_finger = engine.experiment == FINGER_EXPERIMENT
        self.show_panel("finger" if is_finger else "operate")
        connect = self.finger_tab.connect_rig if is_finger else self.connect_rig
        connect(joined_rig(engine))

    def stop(self) -> None:
        """Stop this rig's engines, then all that no other rig of the window has.

        Never asks and never waits.
        """
        self.report("stop", "STOP")
        self.engine_link.stop()
        self.finger_tab.link.stop_own()

    def _engines_of_peers(self) -> set[str]:
        """Return the engines that other rigs of the window have or had last."""
        links = [link for peer in self.peers if peer is not self for link in peer.links]
        return {link.engine.name for link in links if link.engine is not None}

    def _escape(self) -> None:
        """Stop all rigs, and close what is open; where nothing moves, only one of both."""
        if any(peer._drum_may_move() for peer in self.peers):
            self._stop_all()
            self._close_open()
        elif not self._close_open():
            self._stop_all()

    def _stop_all(self) -> None:
        for peer in self.peers:
            peer.stop()

    def _close_open(self) -> bool:
        """Close a question or a page; return whether one was open, or a list or menu.

        Those get the key themselves, and close.
        """
        if QApplication.activePopupWidget() is not None:
            return True
        for question in self._questions:
            if question.isVisible():
                question.hide()
                return True
        page, browser = self.stack.currentWidget(), self.file_browser
        if page is browser:
            browser.dismiss()
        elif page in (self.attach.engines, self.help):
            self._show_view()
        return page in (browser, self.attach.engines, self.help)

    def report(self, kind: str, text: str) -> None:
        """Show an event in the log and the status line; a digest only in the log."""
        self.event_log.add(kind, text)
        if kind != "digest":
            self.status_line.show_event(kind, text)

    def show_panel(self, name: str) -> None:
        """Bring a panel to the front: operate, protocol, analysis or finger."""
        self.docks.show_panel(name)

    def set_theme(self, choice: ThemeChoice) -> None:
        """Apply another theme."""
        self.appearance.set_theme(choice)

    def set_text_size(self, percent: int) -> None:
        """Show all texts larger or smaller, in percent of the usual size."""
        self.appearance.set_text_size(percent)

    def may_close(self) -> bool:
        """Return whether the window may close; during a run ask, unless the user logs out."""
        app = QApplication.instance()
        is_logout = isinstance(app, QGuiApplication) and app.isSavingSession()
        return is_logout or self.attach.may_close()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Leave the engines, which continue a run, and end the worker processes."""
        if not self.may_close():
            event.ignore()
            return
        self.timer.stop()
        self._keys.release()
        self.memory.close()
        self.hide()  # the window does not stay while an engine or a worker ends slowly
        for part in (self.attach, self.tools, self.start.maker, self.replay):
            part.close()
        for tab in self._made_analysis:
            tab.close()
        self.own_plots.close_process(wait_ms=1000)
        self.drum.close()
        self.finger_tab.close()
        self.engine_link.wait_closed()
        super().closeEvent(event)

    def _remember(self) -> None:
        """Restore what the settings hold, and tell what in them is damaged."""
        self.memory.keep_number("speed_mm_s", self.operate_panel.speed)
        self.memory.keep_number("force_g", self.operate_panel.force)
        self.memory.keep_texts(
            {
                **self.protocol_panel.form.remembered,
                **self.finger_tab.setup.remembered,
                "record_in": self.operate_panel.record_box.folder,
                "own_plots": self.own_plots.file,
                "pictures_in": self.live_page.save_strip.folder,
            }
        )
        self.memory.keep_files("protocols", self.protocol_panel.protocol)
        self.memory.keep_files("scan_protocols", self.finger_tab.setup.protocol)
        self.memory.keep_live_views(self.live_page)
        self.memory.restore_layout()
        self._show_view()
        if self.settings.is_first:
            self.start.show_page()
        if complaint := self.settings.complaint():
            self.report("check", complaint)

    def _lay_out(self) -> None:
        self.health = QStackedWidget()
        self.toolbar.add_page(self.finger_tab.bar)
        for strip in (self.health_strip, self.finger_tab.health):
            self.health.addWidget(strip)
        self._add_pages()
        self._add_docks()
        prompts = (self.prompt_panel, self.finger_tab.prompt_panel)
        questions = (self.protocol_panel.unsaved, *prompts, self.run_end_strip)
        self._questions = (self.attach.closing, self.protocol_panel.unsaved)
        offer = self.tools.flash_strip
        strips = (self.drum.alarms.strip, *self.attach.strips, offer, *questions)
        self.regions = Regions(self.toolbar, strips, self.docks)
        body = vbox(
            *strips, self.docks, self.status_line, spacing=3, margins=(8, 0, 8, 0), tall=len(strips)
        )
        column = vbox(self.toolbar, self.health, body, spacing=3, margins=(0, 0, 0, 3), tall=2)
        self.setCentralWidget(container(column))
        self.resize(QSize(WIDTH_PX, HEIGHT_PX).boundedTo(self.screen().availableSize()))

    def _add_pages(self) -> None:
        pages: dict[str, QWidget] = {
            "live": self.live_page,
            "plots": self.own_plots,
            "protocol": self.protocol_panel.page,
            "finger": self.finger_tab.view,
            "files": self.file_browser,
            "help": self.help,
            "engines": self.attach.engines,
        }
        for name, page in pages.items():
            self.stack.add_page(name, page)
        self.stack.show_page("live")

    def _add_docks(self) -> None:
        add = self.docks.add
        add("operate", "Operate", scroll_area(self.operate_panel), _LEFT)
        self._analysis_place = vbox()
        tabs = {
            "protocol": ("Protocol", scroll_area(self.protocol_panel)),
            "analysis": ("Analysis", container(self._analysis_place)),
            "finger": ("Finger", scroll_area(self.finger_tab.panel)),
        }
        for name, (title, panel) in tabs.items():
            add(name, title, panel, _LEFT, tabbed_with="operate")
        add("log", "Log", LogPanel(self.event_log), _BOTTOM)
        self.docks.keep_on_screen("log")
        self.docks.set_first_size("operate", LEFT_PX, Qt.Orientation.Horizontal)
        self.docks.set_first_size("log", LOG_PX, Qt.Orientation.Vertical)
        self.docks.docks["operate"].raise_()

    def _add_menus(self) -> None:
        menus = self.menus
        engines = self.attach.list_engines
        add_rig_menu(menus, self.drum, stop=self.stop, list_engines=engines)
        tip = "Show a further rig in this window, on a page of its own and with a STOP of its own"
        menus.add("Rig", "Add a ri&g to this window", self.rig_wanted.emit, tip=tip)
        tip = "Close the page of this rig, which is disconnected; the others stay"
        menus.add("Rig", "Re&move this rig", self.rig_unwanted.emit, tip=tip)
        self.rigs = RecentRigs(menus, self.settings, self.toolbar)
        self.engine_link.opened.connect(self.rigs.remember_connected)
        menus.add_separator("Rig")
        add_panel_menus(menus, self.operate_panel, self.protocol_panel, self.finger_tab)
        add_lsl_choices(menus, "Rig", self.engine_link)
        add_lsl_choices(menus, "Rig → Finger", self.finger_tab.link)
        menus.add_separator("Rig")
        add_alarm_switches(menus, self.drum, self.settings)
        tip = "Mark the trial that is chosen here bad, or good again; in a run else the newest"
        notes = "Rig → Trials and notes"
        menus.add(notes, "Mark the trial", self._mark_trial, shortcut="Ctrl+B", tip=tip)
        tip = "Go to the field of a note, which marks this moment of a run"
        menus.add(notes, "Note this moment", self._note_now, shortcut="Ctrl+Shift+N", tip=tip)
        self.regions.add_menus(menus)
        self.appearance.add_menus(menus)
        tip = "List the sessions below the data folder: what they hold and how far they are"
        menus.add("File", "Sess&ions", self._list_sessions, shortcut="Ctrl+L", tip=tip)
        self.replay.add_menu(menus)
        add_live_actions(menus, self.live_page, self.settings)
        own = self.own_plots
        tip = "Show curves that a Python file of yours makes of the samples, or the live views"
        menus.add(
            "View",
            "&Own plots",
            lambda: own.show_page(not own.is_wanted),
            shortcut="Ctrl+Shift+O",
            tip=tip,
        )
        self.save_menu = SaveMenu(menus, self.stack)
        menus.add_separator("File")
        menus.add("File", "&Quit", self._close_all, shortcut="Ctrl+Q", tip="Close the window")

    def _close_all(self) -> None:
        self.window().close()

    def _list_sessions(self) -> None:
        self.stack.show_page("sessions")
        self.analysis_tab.sessions.show_folder(self.protocol_panel.out.text().strip())

    def _continue_session(self, session: str, experiment: str) -> None:
        """Record the rest of a session on the rig of its experiment, if that can start."""
        is_finger = experiment == FINGER_EXPERIMENT
        panel = self.finger_tab.run_box if is_finger else self.protocol_panel
        self.show_panel("finger" if is_finger else "protocol")
        if not panel.continue_button.isEnabled():
            self.report("refused", CANNOT_CONTINUE)
        elif is_finger:
            self.finger_tab.run_box.continue_requested.emit(session)
        else:
            self.protocol_panel.continue_session(session)

    def _mark_trial(self) -> None:
        """Mark the trial that the page in the middle shows."""
        if self.replay.is_shown:
            self.replay.page.note_box.mark()
        elif self._panel == "analysis":
            self.analysis_tab.panel.note_box.mark()
        else:
            self.protocol_panel.page.mark_by_key()

    def _note_now(self) -> None:
        """Show the page of the run, with the focus in the field of a note."""
        self.show_panel("protocol")
        self.protocol_panel.show_page(True)
        self.protocol_panel.page.text.setFocus(Qt.FocusReason.ShortcutFocusReason)

    def _open_session(self) -> None:
        self.show_panel("analysis")
        self._browse(PathKind.SESSION, self.analysis_tab.open_session)

    def _connect_panels(self) -> None:
        for place in (self.toolbar, self.docks):
            place.stop_requested.connect(self.stop)
        self.appearance.theme_changed.connect(self._show_theme)
        self.appearance.reported.connect(self.report)
        self.engine_link.status_changed.connect(lambda _: self.appearance.follow_system())
        self.drum.title_changed.connect(self.setWindowTitle)
        boxes = (self.toolbar.rig, self.toolbar.world)
        panels = (self.operate_panel, self.protocol_panel, self.finger_tab)
        self.replay.view_changed.connect(self._show_view)
        for link in self.links:
            link.opened.connect(self._follow_live)
            link.closed.connect(lambda _: self._follow_live())
        self.own_plots.changed.connect(self._show_view)
        strips = (self.own_plots, self.live_page.save_strip, self.live_page.encoder_strip)
        for widget in (*boxes, *panels, *strips, self.replay, self.tools):
            widget.path_requested.connect(self._browse)
        for source in (self.drum, self.finger_tab, self.replay, self.tools):
            source.reported.connect(self.report)
        self._connect_attach()
        self.start.sessions_requested.connect(self._list_sessions)
        run_end = self.run_end_strip
        self.engine_link.status_changed.connect(run_end.show_status)
        run_end.analyse_requested.connect(self._analyse)
        run_end.continue_requested.connect(self.protocol_panel.continue_session)
        self.docks.panel_used.connect(self._use_panel)
        opened_by = (self.sessions.open_requested, self.start.session_requested)
        for offers in (*opened_by, self.tools.session_requested):
            offers.connect(self._analyse)
        self.sessions.browse_requested.connect(self._open_session)
        self.help.reported.connect(self.report)
        self.help.shown.connect(partial(self.stack.show_page, "help"))
        self.start.virtual_requested.connect(self.connect_rig)
        self.tools.connect_requested.connect(self.connect_rig)
        suggest = self.tools.setup_page.boards.suggest
        chosen = self.toolbar.rig
        chosen.currentIndexChanged.connect(lambda _: suggest(chosen.currentData() or ""))
        self.start.reported.connect(self.report)
        self.start.browse_requested.connect(self._open_session)
        for pages in (self.file_browser, self.tools, self.help, self.start):
            pages.closed.connect(self._show_view)
        self.protocol_panel.page_changed.connect(self._show_view)
        self.operate_panel.bring_up.calibrate_requested.connect(self.tools.show_calibration)
        self.operate_panel.bring_up.setup_requested.connect(self.tools.show_setup)

    def _follow_live(self) -> None:
        """Let own plots take the samples of the panel's rig, else of the other one."""
        links = self.links[::-1] if self._panel == "finger" else self.links
        live = [link.engine.live for link in links if link.is_connected and link.engine is not None]
        self.own_plots.follow(live[0] if live else "")

    def _connect_sessions(self, sessions: SessionList) -> None:
        """Let the list of sessions act in the panels."""
        sessions.verified = self._verified_on
        sessions.continue_requested.connect(self._continue_session)
        sessions.analyse_requested.connect(self._analyse)
        sessions.add_requested.connect(self._add_to_analysis)
        sessions.overlay_requested.connect(self._lay_over)
        sessions.export_requested.connect(self.tools.show_export)
        sessions.path_requested.connect(self._browse_sessions)
        sessions.closed.connect(self._show_view)

    def _browse_sessions(self, kind: PathKind, selected: Callable[[str], None]) -> None:
        """Let the user choose a folder, and come back to the list."""

        def take(path: str) -> None:
            selected(path)
            self.stack.show_page("sessions")

        self._browse(kind, take)

    def _add_to_analysis(self, session: str) -> None:
        """Open a session beside those that are open, or as the first one."""
        panel = self.analysis_tab.panel
        if panel.run_box.form.sessions:
            panel.run_box.form.add_session(session)
        else:
            self.analysis_tab.open_session(session)
        self.report("analysis", f"added to the analysis: {session}")

    def _verified_on(self, line: SessionLine) -> str:
        """Return the day on which a session was found whole, if it is as old as that."""
        on = self.settings.value(f"verified/{line.closing_digest}", "")
        return on[:10] if on >= line.modified_utc else ""

    def _keep_verified(self, digest: str) -> None:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self.settings.set_value(f"verified/{digest}", now)
        self.analysis_tab.sessions.show_verified()

    def _connect_attach(self) -> None:
        attach = self.attach
        attach.join_requested.connect(self.join_engine)
        attach.start_requested.connect(self.drum.start_another)
        attach.start_finger_requested.connect(self.finger_tab.start_another)
        attach.engines.shown.connect(lambda: self.stack.show_page("engines"))
        attach.engines.closed.connect(self._show_view)
        attach.close_confirmed.connect(self._close_all)
        attach.reported.connect(self.report)
        attach.history_received.connect(self._show_history)
        panels = (self.operate_panel, self.protocol_panel)
        tools = (self.tools.calibrate_page, self.tools.setup_page)
        drum = drum_controls(*panels, self.prompt_panel, *tools)
        controls = (drum, finger_controls(self.finger_tab))
        self._locks = tuple(map(ControlLock, attach.shared, controls))
        for panel in (*panels, *tools):
            self._locks[0].released.connect(
                lambda panel=panel: panel.show_status(self.engine_link.status)
            )

    def _show_history(self, lines: list[PastLine]) -> None:
        """Show what was logged before the window joined, with the times of then."""
        for at, kind, text in lines:
            self.event_log.add(kind, text, at.time())

    def _analyse(self, session: str) -> None:
        """Open a session in the Analysis panel and bring it to the front."""
        self.show_panel("analysis")
        self.analysis_tab.open_session(session)

    def _lay_over(self, sessions: tuple[str, ...]) -> None:
        """Open sessions in the Analysis panel, and show a trial of each in one plot."""
        self.show_panel("analysis")
        self.analysis_tab.lay_over(sessions)

    def _browse(self, kind: PathKind, selected: Callable[[str], None]) -> None:
        self.file_browser.open(kind, selected, self.protocol_panel.out.text().strip())
        self.stack.setCurrentWidget(self.file_browser)

    def _use_panel(self, name: str) -> None:
        """Let heading, health figures and the middle follow the panel that is used."""
        if name != "log" and name != self._panel:
            self._panel = name
            self.replay.leave()
            self._follow_live()
            self._show_view()

    def is_at_rest(self) -> bool:
        """Whether nothing goes on at any rig of this window that STOP would end."""
        return all(peer._rests() for peer in self.peers)

    def _rests(self) -> bool:
        finger = self.finger_tab.link
        return self._drum_rests() and not (finger.status.run.is_active or finger.is_waiting)

    def _drum_rests(self) -> bool:
        link, status = self.engine_link, self.engine_link.status
        if status.run.is_active or link.is_waiting:
            return False
        rests = status.state in RESTING_STATES and not status.calibration.measuring
        return rests or not link.is_connected

    def _drum_may_move(self) -> bool:
        """Whether the drum moves, presses or has a run, or nobody knows."""
        link = self.engine_link
        return not self._drum_rests() or link.status.contact_may_stand or link.is_unheard

    def _show_theme(self, theme: Theme) -> None:
        """Give the plots, which have colours of their own, those of another theme."""
        for peer in self.peers:
            peer.appearance.take(self.appearance)
            peer._colour(theme)

    def _colour(self, theme: Theme) -> None:
        self.live_plots.set_theme(theme)
        self.own_plots.set_theme(theme)
        self.replay.set_theme(theme)
        for tab in self._made_analysis:
            tab.set_theme(theme)
        self.finger_tab.view.set_theme(theme)
        self.event_log.reset_colours()

    def _show_view(self) -> None:
        live = self.finger_tab.view if self._panel == "finger" else self.live_page
        views: dict[str, QWidget] = {}
        if self._panel == "analysis":
            views["analysis"] = self.analysis_tab.view
        if self.protocol_panel.shows_page:
            views["protocol"] = self.protocol_panel.page
        view = views.get(self._panel, self.own_plots if self.own_plots.is_wanted else live)
        self.stack.setCurrentWidget(self.replay.page if self.replay.is_shown else view)
        for pages in (self.toolbar.pages, self.health):
            pages.setCurrentIndex(int(self._panel == "finger"))
