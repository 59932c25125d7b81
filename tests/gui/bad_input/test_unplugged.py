"""A board is unplugged in each state of the drum: a strip names it, and the work goes on after."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from gui.analysis.open_sessions import OpenSessions
from rigctl.boards.drum_states import State
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.gui.rig_window import RigWindow
from tests.gui.running_engine import ridges
from tests.gui.steps import click, press_escape

BOARDS = {"drum": "No drum board answers", "taxels": "No taxel board answers"}
NEWS_S = 0.5
"""Engine time after which a status tells what a board has said since."""
CURE = "check its cable and its supply"
LONG = ridges("long", 50, speed_mm_s=60)


def _is_back(rig: RigWindow) -> bool:
    return rig.status.drum_connected and rig.status.taxels_connected


def _unplug_and_plug_in(rig: RigWindow, board: str) -> None:
    """Unplug a board, read the alarm, plug the board in, and see the alarm go."""
    strip = rig.window.drum.alarms.strip
    rig.window.show_panel("operate")
    rig.inject(f"Unplug the {board}")
    rig.until(lambda: strip.isVisible() and BOARDS[board] in strip.text.text())
    rig.until(lambda: f"done  bench: Unplug the {board}" in rig.log)
    assert CURE in strip.text.text() and strip.title.text().startswith("BOARD LOST")
    rig.inject(f"Plug in the {board}")
    rig.until(partial(_is_back, rig))
    rig.until(lambda: BOARDS[board] not in strip.text.text() or not strip.isVisible())
    if board == "taxels":
        assert 0 <= rig.status.lost_age_s < 60 and rig.status.lost_samples


def _reach(rig: RigWindow, state: State) -> None:
    """Bring the drum by hand from wherever it is into a state.

    The fault of a drum that was unplugged comes after the window knows that it is back.
    """
    began_s = rig.status.at_s
    rig.until(lambda: rig.status.at_s > began_s + NEWS_S)
    if rig.status.state is State.HOLD:
        rig.press("retract")
        rig.until_state(State.ARMED)
    rig.bring_up()
    if state is State.IDLE:
        rig.press("disarm")
    if state in (State.HOLD, State.RUN):
        rig.press("approach")
        rig.until_state(State.HOLD)
    if state is State.RUN:
        rig.press("run")
    rig.until(lambda: rig.status.state is state or bool(rig.status.fault))
    if rig.status.fault:
        _reach(rig, state)


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("state", [State.IDLE, State.ARMED, State.HOLD, State.RUN])
def test_by_hand(rig: RigWindow, state: State, board: str, tmp_path: Path) -> None:
    box = rig.window.operate_panel.record_box
    _reach(rig, state)
    box.folder.setText(str(tmp_path))
    click(box.button)
    rig.until(lambda: rig.status.recording.samples_on_disk > 500)
    before = rig.status.recording.samples_on_disk
    _unplug_and_plug_in(rig, board)
    rig.until(lambda: rig.status.recording.samples_on_disk > before + 500)
    click(box.button)
    rig.until(lambda: box.button.text() == "Record")
    (folder,) = tmp_path.iterdir()
    assert verify(folder).problems == []
    assert "recorded by hand, so it has no trials" in OpenSessions().open(str(folder)).about
    rig.until_state(State.IDLE, State.ARMED, State.HOLD, State.FAULT_OFF)
    assert "Traceback" not in rig.log


def _begin(rig: RigWindow, state: State) -> None:
    """Bring the drum into a state that it leaves by itself, or into a fault."""
    _reach(rig, State.HOLD if state is State.RETRACT else State.ARMED)
    if state is State.POSITION:
        rig.window.engine_link.request("jog", mm=400.0)
    elif state is State.FAULT_OFF:
        rig.inject("Press the E-stop")
    else:
        rig.press({State.APPROACH: "approach", State.RETRACT: "retract"}[state])
    rig.until_state(state)


@pytest.mark.parametrize("state", [State.POSITION, State.APPROACH, State.RETRACT, State.FAULT_OFF])
def test_a_moving_or_faulty_drum(rig: RigWindow, state: State) -> None:
    _begin(rig, state)
    _unplug_and_plug_in(rig, "drum")
    rig.inject("Release the E-stop")
    rig.until(lambda: not rig.status.estop_pressed)
    rig.bring_up()
    assert "Traceback" not in rig.log


def _run(rig: RigWindow, folder: Path) -> None:
    """Start a long protocol, and wait until it turns in its second trial."""
    protocol = folder / "long.toml"
    protocol.write_text(LONG)
    rig.start(protocol, folder)
    rig.until(lambda: rig.status.run.trials_committed == 1)
    rig.until_state(State.RUN)


def _verified(rig: RigWindow) -> None:
    """Demand that the session is whole and has what was recorded before."""
    folder = Path(rig.status.run.session)
    assert verify(folder).problems == [] and "Traceback" not in rig.log
    with Session.open(folder) as session:
        assert len(session.committed()) >= 1


def test_a_run_that_was_stopped_by_hand_ends_and_says_how_to_go_on(
    rig: RigWindow, tmp_path: Path
) -> None:
    strip = rig.window.drum.alarms.strip
    _run(rig, tmp_path)
    rig.inject("Press the E-stop")
    rig.until(lambda: rig.status.run.state == "failed")
    _verified(rig)
    rig.inject("Release the E-stop")
    rig.until(lambda: not rig.status.estop_pressed)
    rig.press("clear_fault")
    rig.until_state(State.IDLE)
    rig.press("arm")  # the stop left it in contact
    rig.until(lambda: strip.title.text() == "RUN FAILED")
    assert "Emergency stop pressed" in strip.text.text()
    assert "1 of 50 trials) is kept" in strip.text.text()
    assert "Continue a session" in strip.text.text()
    click(strip.dismiss)


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("is_paused", [False, True])
def test_a_run_waits_for_a_board_that_is_lost(
    rig: RigWindow, is_paused: bool, board: str, tmp_path: Path
) -> None:
    panel = rig.window.protocol_panel
    _run(rig, tmp_path)
    if is_paused:
        click(panel.buttons["Pause"])
        rig.until(lambda: rig.status.run.state == "paused")
    _unplug_and_plug_in(rig, board)
    if is_paused:
        rig.window.show_panel("protocol")
        rig.until(panel.buttons["Resume"].isEnabled)
        click(panel.buttons["Resume"])
    rig.until(lambda: rig.status.run.trials_committed >= 2)
    press_escape(rig.window)
    rig.until(lambda: rig.status.run.state == "aborted")
    _verified(rig)
