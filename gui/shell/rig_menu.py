"""The Rig menu: connect, STOP, the running engines, the sound of alarms."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtWidgets import QWidget

from gui.finger.finger_tab import FingerTab
from gui.operate.calibrate import CalibratePage
from gui.operate.operate_panel import OperatePanel, PromptPanel
from gui.protocol.protocol_panel import ProtocolPanel
from gui.setup.setup_page import SetupPage
from gui.shell.actions import ActionRegistry
from gui.shell.drum_controller import DrumController
from gui.shell.user_settings import UserSettings


def drum_controls(
    operate: OperatePanel,
    protocol: ProtocolPanel,
    prompt: PromptPanel,
    calibrate: CalibratePage,
    setup: SetupPage,
) -> list[QWidget]:
    """Return what acts on the drum rig, but STOP."""
    bench, queue = operate.bench, protocol.queue
    by_hand = (operate.set_button, operate.bring_up.next, operate.record_box.button)
    return [
        *operate.buttons.values(),
        *operate.jog.buttons.values(),
        *by_hand,
        *(bench.plate, bench.inject, bench.wire),
        *protocol.buttons.values(),
        *(protocol.continue_button, queue.next_button),
        *(prompt.confirm, prompt.abort),
        *calibrate.controls,
        *setup.controls,
    ]


def finger_controls(finger: FingerTab) -> list[QWidget]:
    """Return what acts on the rig of the moving finger, but STOP."""
    box, prompt = finger.run_box, finger.prompt_panel
    runs = (*box.buttons.values(), box.continue_button, box.models_button, box.inject)
    return [*runs, prompt.confirm, prompt.abort]


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
