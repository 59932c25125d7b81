"""The Rig menu: connect, STOP, the running engines, the sound of alarms."""

from __future__ import annotations

from collections.abc import Callable

from gui.shell.actions import ActionRegistry
from gui.shell.controllers.drum_controller import DrumController
from gui.shell.memory.user_settings import UserSettings

SOUND_KEY = "alarm_sound"


def add_rig_menu(
    menus: ActionRegistry,
    drum: DrumController,
    *,
    stop: Callable[[], object],
    list_engines: Callable[[], object],
) -> None:
    """Add the actions of the drum rig."""
    click = drum.toolbar.connect_button.click
    menus.add("Rig", "&Connect or disconnect", click, shortcut="Ctrl+R", tip="The chosen rig")
    menus.add("Rig", "&STOP", stop, tip="Stop and lift the drum, and end every run (Esc)")
    tip = "List the engines that run already, and join one of them"
    menus.add("Rig", "&Running engines", list_engines, tip=tip)


def add_alarm_sound(menus: ActionRegistry, drum: DrumController, settings: UserSettings) -> None:
    """Add the switch of the sound, which the settings keep."""
    announcer = drum.safety.alarms.announcer

    def switch(sounds: bool) -> None:
        announcer.sounds = sounds
        settings.set_value(SOUND_KEY, sounds)

    tip = "Beep until an alarm is over or silenced"
    action = menus.add("Rig", "Alarm &sound", switch, tip=tip, checkable=True)
    action.setChecked(settings.value(SOUND_KEY, True))
    announcer.sounds = action.isChecked()
