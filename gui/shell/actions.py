"""The menus, and a registry of every action in them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from PySide6.QtCore import QKeyCombination, Qt
from PySide6.QtGui import QAction, QActionGroup, QKeyEvent, QKeySequence
from PySide6.QtWidgets import QMenu, QMenuBar

MENUS = ("File", "Rig", "View", "Tools", "Help")


BELOW = " → "
"""Stands between a menu and its submenu."""


_ROWS = {2: "1234567890", 16: "QWERTYUIOP", 30: "ASDFGHJKL", 44: "ZXCVBNM"}
"""Letters of the keys by the scan code of the first in a row; X11 and Wayland count from 8."""
_LETTERS = {first + place: ord(c) for first, row in _ROWS.items() for place, c in enumerate(row)}
_OFFSET = 8 if sys.platform.startswith("linux") else 0
_LATIN_END, _SPECIAL = 0x80, 0x01000000


def keys_by_position(event: QKeyEvent) -> QKeySequence:
    """Return the keys that stand where a Cyrillic or Greek letter was pressed with Ctrl.

    Empty for all else: Qt matches shortcuts by the letters of the layout.
    """
    letter = _LETTERS.get(event.nativeScanCode() - _OFFSET)
    has_control = bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)
    if letter is None or not has_control or not _LATIN_END <= event.key() < _SPECIAL:
        return QKeySequence()
    return QKeySequence(QKeyCombination(event.modifiers(), Qt.Key(letter)))


class ActionRow(NamedTuple):
    """A line of the shortcut sheet: menu, text, shortcut (empty without one) and what it does."""

    menu: str
    text: str
    shortcut: str
    tip: str


class ActionRegistry:
    """Adds actions to the menus of a menu bar and remembers them for the shortcut sheet.

    A menu is visible once it has an action.
    """

    def __init__(self, bar: QMenuBar) -> None:
        self._menus = {name: bar.addMenu(f"&{name}") for name in MENUS}
        self._actions: list[tuple[str, QAction]] = []
        for menu in self._menus.values():
            menu.setToolTipsVisible(True)
            menu.menuAction().setVisible(False)

    def add(
        self,
        menu: str,
        text: str,
        slot: Callable[..., object],
        *,
        shortcut: str = "",
        tip: str = "",
        checkable: bool = False,
    ) -> QAction:
        """Add an action to a menu or submenu; a checkable one passes its new state."""
        action = QAction(text, self._menu(menu), checkable=checkable)
        action.setShortcut(QKeySequence(shortcut))
        action.setToolTip(tip)
        if checkable:
            action.toggled.connect(slot)
        else:
            action.triggered.connect(lambda _=False: slot())
        return self.add_action(menu, action)

    def add_action(self, menu: str, action: QAction) -> QAction:
        """Add an action that Qt made, such as the one that shows a dock.

        ``menu`` may be a submenu, ``Rig → Protocol``, which is made where it is absent.
        """
        action.setParent(self._menu(menu))
        self._menu(menu).addAction(action)
        self._actions.append((menu, action))
        return action

    def add_choices(
        self,
        menu: str,
        text: str,
        choices: Mapping[str, Any],
        checked: Any,
        chosen: Callable[[Any], object],
    ) -> dict[Any, QAction]:
        """Add a submenu of exclusive choices; return the action of each value."""
        submenu = self._menu(menu).addMenu(text)
        group = QActionGroup(submenu)
        actions = {}
        for name, value in choices.items():
            action = group.addAction(submenu.addAction(name))
            action.setCheckable(True)
            action.setChecked(value == checked)
            action.triggered.connect(lambda _=False, value=value: chosen(value))
            self._actions.append((f"{menu}{BELOW}{text.replace('&', '')}", action))
            actions[value] = action
        return actions

    def add_menu(self, menu: str, text: str) -> QMenu:
        """Add an empty submenu, whose lines come and go, to a menu."""
        return self._menu(menu).addMenu(text)

    def add_separator(self, menu: str) -> None:
        """Add a line between two groups of actions."""
        self._menus[menu].addSeparator()

    def actions(self) -> list[tuple[str, QAction]]:
        """Return all actions, each with the path of its menu."""
        return list(self._actions)

    def at(self, keys: QKeySequence) -> QAction | None:
        """Return the action of a shortcut, None without one that is on."""
        return next((a for _, a in self._actions if a.shortcut() == keys and a.isEnabled()), None)

    def rows(self) -> list[ActionRow]:
        """Return all actions in the order of the menus."""
        order = {name: place for place, name in enumerate(MENUS)}
        rows = sorted(self._actions, key=lambda row: order[row[0].partition(" ")[0]])
        return [_row(menu, action) for menu, action in rows]

    def _menu(self, name: str) -> QMenu:
        top, _, below = name.partition(BELOW)
        self._menus[top].menuAction().setVisible(True)
        if name not in self._menus:
            self._menus[name] = self._menus[top].addMenu(f"&{below}")
            self._menus[name].setToolTipsVisible(True)
        return self._menus[name]


def _row(menu: str, action: QAction) -> ActionRow:
    text = action.text().replace("&", "")
    tip = action.toolTip()
    return ActionRow(menu, text, action.shortcut().toString(), "" if tip == text else tip)
