"""Switches off what acts on the rig, in a window that only watches."""

from __future__ import annotations

from collections.abc import Iterable

from PySide6.QtCore import QEvent, QObject, Signal
from PySide6.QtWidgets import QWidget

from gui.attach.shared_control import SharedControl


class ControlLock(QObject):
    """Keeps controls off, with the reason as tooltip, while another client has control.

    A control that its panel enables meanwhile stays off. STOP is never among the controls.
    """

    released = Signal()
    """This window has control again; each panel shows what is possible now."""

    def __init__(self, shared: SharedControl, controls: Iterable[QWidget]) -> None:
        super().__init__()
        self._shared, self._controls = shared, tuple(controls)
        self._reason = ""
        self._tooltips: dict[QWidget, str] = {}
        for control in self._controls:
            control.installEventFilter(self)
        shared.changed.connect(self._follow)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep a control off that its panel changes."""
        kinds = (QEvent.Type.EnabledChange, QEvent.Type.ToolTipChange)
        if self._reason and event.type() in kinds and isinstance(watched, QWidget):
            self._lock(watched)
        return False

    def _follow(self) -> None:
        before, now = self._reason, _reason(self._shared)
        if now == before:
            return
        self._reason = ""
        self._restore()
        self._reason = now
        for control in self._controls if now else ():
            self._lock(control)
        if not now:
            self.released.emit()

    def _lock(self, control: QWidget) -> None:
        if control.toolTip() != self._reason:
            self._tooltips[control] = control.toolTip()
            control.setToolTip(self._reason)
        control.setEnabled(False)

    def _restore(self) -> None:
        tooltips, self._tooltips = self._tooltips, {}
        for control, tooltip in tooltips.items():
            control.setToolTip(tooltip)
            control.setEnabled(True)


def _reason(shared: SharedControl) -> str:
    """Return why this window cannot act on the rig; empty where it can."""
    if not shared.number or shared.has_control:
        return ""
    return f"{shared.state.holder_name} has control: ask for it, or take it, at the top"
