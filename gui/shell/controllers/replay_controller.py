"""Replay in the window: its page, and the trial that is chosen in Analysis."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.analysis.session_panel import SessionPanel
from gui.analysis.tasks.task_values import DRUM
from gui.live.replay.replay_page import ReplayPage
from gui.shell.actions import ActionRegistry
from gui.shell.memory.recent_paths import RecentSessions
from gui.widgets.theme import Theme


class ReplayController(QObject):
    """Shows and hides the page, which takes over what was chosen last."""

    view_changed = Signal()
    """:attr:`is_shown` has changed."""

    def __init__(self, theme: Theme, panel: SessionPanel, sessions: RecentSessions) -> None:
        super().__init__()
        self.page, self.is_shown = ReplayPage(theme), False
        self._panel, self._sessions = panel, sessions
        self._chosen: tuple[str, int] | None = None
        """A trial that was chosen in Analysis and is not taken over yet."""
        panel.trial_requested.connect(self._choose)
        panel.replay_requested.connect(self._replay)
        self.page.opened.connect(sessions.remember)
        self.page.closed.connect(self.hide)

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

    def hide(self) -> None:
        """Show the page that was there before."""
        self.leave()
        self.view_changed.emit()

    def leave(self) -> None:
        """Let another page take the middle."""
        self.is_shown = False

    def _choose(self, path: str, row: int) -> None:
        """Take over a trial now if the page is on the screen, else when it is shown."""
        if self._panel.sessions[path].experiment != DRUM:
            return
        if self.page.isVisible():
            self.page.open(path, row)
        else:
            self._chosen = path, row

    def _replay(self, path: str, row: int) -> None:
        """Play a trial from its beginning."""
        self._chosen = None
        self.is_shown = True
        self.view_changed.emit()
        self.page.open(path, row, plays=True)
