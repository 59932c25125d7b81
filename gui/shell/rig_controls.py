"""The controls that act on a rig, which a window that only watches switches off."""

from __future__ import annotations

from PySide6.QtWidgets import QWidget

from gui.calibrate.calibrate_page import CalibratePage
from gui.finger.finger_tab import FingerTab
from gui.operate.operate_panel import OperatePanel
from gui.operate.prompt import PromptPanel
from gui.protocol.protocol_panel import ProtocolPanel
from gui.setup.setup_page import SetupPage


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
