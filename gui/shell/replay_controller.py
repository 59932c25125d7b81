"""Replay in the window: its page, and the trial that is chosen in Analysis."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from gui.analysis.task_values import DRUM
from gui.shell.actions import ActionRegistry
from gui.shell.docks import PageStack
from gui.shell.user_settings import RecentSessions
from gui.widgets.theme import Theme

if TYPE_CHECKING:
    from gui.analysis.session_panel import SessionPanel
    from gui.live.replay_page import ReplayPage

NAME = "replay"


class ReplayController(QObject):
    """Shows and hides the page, which takes over what was chosen last.

    The page is made when it is first needed: the window is there a tenth of a second sooner.
    """

    reported = Signal(str, str)
    """Kind and text for the event log."""
    path_requested = Signal(object, object)
    """A :class:`~gui.widgets.file_browser.PathKind`, and the function that takes the path."""
    view_changed = Signal()
    """:attr:`is_shown` has changed."""

    def __init__(self, theme: Theme, stack: PageStack, sessions: RecentSessions) -> None:
        super().__init__()
        self.is_shown = False
        self.author: Callable[[], str] = str
        """Returns who writes notes."""
        self.place_of: Callable[[str], Path] = Path
        """Returns the folder for pictures of a session."""
        self._theme, self._stack, self._sessions = theme, stack, sessions
        self._chosen: tuple[str, int] | None = None
        """A trial that was chosen in Analysis and is not taken over yet."""

    def follow_choice(self, panel: SessionPanel) -> None:
        """Take over the trials that are chosen in a panel from now on."""
        panel.trial_requested.connect(partial(self._choose, panel))
        panel.replay_requested.connect(self._replay)

    @cached_property
    def page(self) -> ReplayPage:
        """The page, in the stack of the window."""
        from gui.live.replay_page import ReplayPage

        page = ReplayPage(self._theme)
        page.author, page.place_of = self.author, self.place_of
        page.opened.connect(self._sessions.remember)
        page.closed.connect(self.hide)
        page.reported.connect(self.reported)
        page.path_requested.connect(self.path_requested)
        self._stack.add_page(NAME, page)
        return page

    @property
    def is_made(self) -> bool:
        """Whether there is a page."""
        return "page" in vars(self)

    def poll(self) -> None:
        """Let the page show the present moment."""
        if self.is_made:
            self.page.poll()

    def close(self) -> None:
        """End the page's worker process."""
        if self.is_made:
            self.page.close_files()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        if self.is_made:
            self.page.set_theme(theme)

    def add_menu(self, menus: ActionRegistry) -> None:
        """Add the action that shows the page."""
        tip = "Play recorded trials in the live views, at any speed"
        menus.add("File", "&Replay a session", self.show, shortcut="Ctrl+Shift+R", tip=tip)

    def show(self) -> None:
        """Show the page with the trial that was chosen last, else with the last session's path."""
        self.is_shown = True
        self.view_changed.emit()
        if self._chosen is not None:
            (path, row), self._chosen = self._chosen, None
            self.page.open(path, row)
        elif recent := self._sessions.newest():
            self.page.offer(recent)

    def follow(self, path: str) -> None:
        """Show the newest attempt of a session that grows, and each that comes."""
        self.is_shown = True
        self.view_changed.emit()
        self.page.follow(path)

    def hide(self) -> None:
        """Show the page that was there before."""
        self.leave()
        self.view_changed.emit()

    def leave(self) -> None:
        """Let another page take the middle."""
        self.is_shown = False

    def _choose(self, panel: SessionPanel, path: str, row: int) -> None:
        """Take over a trial now if the page is on the screen, else when it is shown."""
        if panel.sessions[path].experiment != DRUM:
            return
        if self.is_made and self.page.isVisible():
            self.page.open(path, row)
        else:
            self._chosen = path, row

    def _replay(self, path: str, row: int) -> None:
        """Play a trial from its beginning."""
        self._chosen = None
        self.is_shown = True
        self.view_changed.emit()
        self.page.open(path, row, plays=True)
