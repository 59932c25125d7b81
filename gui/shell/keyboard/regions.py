"""The regions of the window, which F6 visits in turn: heading, strips, panel, middle, log."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtWidgets import QApplication, QWidget

from gui.shell.actions import ActionRegistry
from gui.shell.docks import DockArea
from gui.shell.keyboard.steady_focus import give_focus, neighbour_of


class Regions:
    """Moves the focus into a region: to its first control, so that no Tab leads through all."""

    def __init__(self, heading: QWidget, strips: Sequence[QWidget], docks: DockArea) -> None:
        self._above, self._docks = (heading, *strips), docks

    def add_menus(self, menus: ActionRegistry) -> None:
        """Add the keys of regions and panels to the View menu."""
        tip = "Move the keyboard's focus to heading, question, panel, middle or log"
        menus.add("View", "&Next region", self.show_next, shortcut="F6", tip=tip)
        tip = "Move the keyboard's focus back by one region"
        menus.add("View", "Pre&vious region", self.show_previous, shortcut="Shift+F6", tip=tip)
        for number, (name, dock) in enumerate(self._docks.docks.items(), start=1):
            tip = "Bring this panel to the front, with the keyboard's focus"
            text, keys = dock.windowTitle(), f"Ctrl+{number}"
            menus.add("View", text, lambda name=name: self.show_panel(name), shortcut=keys, tip=tip)
        menus.add("View", "&Reset the layout", self._docks.reset, tip="Put all panels back")

    def show_panel(self, name: str) -> None:
        """Bring a panel to the front and the focus to its first control."""
        self._docks.show_panel(name)
        focus_first(self._docks.docks[name])

    def show_next(self) -> None:
        """Move the focus to the next region."""
        self._move(1)

    def show_previous(self) -> None:
        """Move the focus to the region before."""
        self._move(-1)

    def _move(self, step: int) -> None:
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
