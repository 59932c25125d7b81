"""Sound and desktop notice of an alarm, for people who do not look at the window."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QApplication, QStyle, QSystemTrayIcon

REPEAT_MS = 4000
NOTICE_MS = 10_000
Notify = Callable[[str, str], None]


class Announcer(QObject):
    """Beeps until an alarm is over or silenced, and shows each new one on the desktop."""

    def __init__(
        self, beep: Callable[[], None] = QApplication.beep, notify: Notify | None = None
    ) -> None:
        super().__init__()
        self.sounds = True
        """Whether alarms beep."""
        self._beep = beep
        self._notify = notify if notify is not None else DesktopNotice(self)
        self._repeat = QTimer(self)
        self._repeat.setInterval(REPEAT_MS)
        self._repeat.timeout.connect(self._sound)

    @property
    def is_sounding(self) -> bool:
        """Whether an alarm beeps again and again."""
        return self._repeat.isActive()

    def announce(self, title: str, text: str, *, repeats: bool) -> None:
        """Tell of something new; ``repeats`` goes on until :meth:`silence`."""
        self._sound()
        self._notify(title, text)
        if repeats:
            self._repeat.start()

    def silence(self) -> None:
        """Beep no more."""
        self._repeat.stop()

    def _sound(self) -> None:
        if self.sounds:
            self._beep()


class DesktopNotice(QObject):
    """A notice of the desktop through the system tray, where there is one."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._icon: QSystemTrayIcon | None = None

    def __call__(self, title: str, text: str) -> None:
        """Show a notice, and mark the window in the task bar."""
        for window in QApplication.topLevelWidgets():
            QApplication.alert(window)
        if not QSystemTrayIcon.isSystemTrayAvailable():
            return
        if self._icon is None:
            style = QApplication.style()
            icon = style.standardIcon(QStyle.StandardPixmap.SP_MessageBoxWarning)
            self._icon = QSystemTrayIcon(icon, self)
        self._icon.show()
        warning = QSystemTrayIcon.MessageIcon.Warning
        self._icon.showMessage(f"rigctl: {title}", text, warning, NOTICE_MS)
