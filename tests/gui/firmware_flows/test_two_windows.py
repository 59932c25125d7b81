"""A second window joins the firmware's engine, gets control and leaves it behind."""

from __future__ import annotations

from rigctl.boards.drum_states import State
from tests.gui.rig_window import RigWindow, opened_window
from tests.gui.steps import click


def test_a_second_window_gets_control_and_leaves(rig: RigWindow) -> None:
    first = rig.window.attach
    with opened_window() as other:
        second = other.window.attach
        second.announce()
        other.until(second.engines.isVisible)
        click(second.engines.join_buttons[-1])
        other.until(second.controls[0].isVisible)
        other.until(lambda: other.status.drum_connected)
        arm = other.window.operate_panel.buttons["arm"]
        assert not arm.isEnabled() and "has control: ask for it" in arm.toolTip()
        other.window.engine_link.request("arm")
        other.until(lambda: "this client only watches" in other.log)
        click(second.controls[0].ask)
        rig.until(first.controls[0].isVisible)
        click(first.controls[0].give)
        other.until(lambda: second.shared[0].has_control)
        other.press("arm")
        rig.until_state(State.ARMED)
        assert first.controls[0].isVisible()
    rig.until(lambda: first.shared[0].has_control)
    assert not first.controls[0].isVisible() and rig.status.drum_connected
    rig.press("disarm")
    rig.until_state(State.IDLE)
