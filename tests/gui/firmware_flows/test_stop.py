"""Esc stops the firmware's drum in a run and in a jog, and the work goes on after it."""

from __future__ import annotations

import pytest

from rigctl.boards.drum_states import State
from tests.gui.rig_window import RigWindow
from tests.gui.steps import click, press_escape

STEP_MM = 0.03125  # of texture


def _go_on(rig: RigWindow) -> None:
    """Clear what STOP left, if it left a fault, and have the drum armed and lifted again."""
    rig.until_state(State.ARMED, State.FAULT_OFF, State.IDLE)
    if rig.status.fault:
        rig.press("clear_fault")
        rig.until(lambda: not rig.status.fault)
    if rig.status.state is State.IDLE:
        rig.press("arm")
    rig.until_state(State.ARMED)


def test_escape_in_a_run_lifts_the_drum_and_work_goes_on(rig: RigWindow) -> None:
    rig.bring_up()
    for _ in range(2):
        rig.press("approach")
        rig.until_state(State.HOLD)
        rig.press("run")
        rig.until(lambda: rig.status.speed_mm_s > 20)
        press_escape(rig.window.operate_panel.buttons["retract"])
        rig.until(lambda: rig.status.state is not State.RUN)
        _go_on(rig)
        rig.until(lambda: rig.status.speed_mm_s == 0)


@pytest.mark.parametrize("mm", [10, -10])
def test_escape_in_a_jog_ends_it_and_the_next_jog_moves(rig: RigWindow, mm: int) -> None:
    jog = rig.window.operate_panel.jog
    rig.bring_up()
    rig.until(jog.buttons[mm].isEnabled)
    before = rig.status.steps
    click(jog.buttons[mm])
    press_escape(rig.window)
    rig.until(lambda: "jog: ended by STOP" in rig.log)
    _go_on(rig)
    ended_s = rig.status.at_s
    # Steps are told until it stands, and a status may be older than the end of the jog.
    rig.until(lambda: rig.status.at_s > ended_s + 0.5 and rig.status.speed_mm_s == 0)
    rig.until(jog.buttons[mm].isEnabled)
    after = rig.status.steps
    assert abs(after - before) * STEP_MM < abs(mm)
    click(jog.buttons[mm])
    rig.until(lambda: rig.status.steps - after == mm / STEP_MM)
