"""Alarms stay on screen, sound until they are silenced, and say how to go on."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu

from gui.operate.alarms import Announcer
from gui.operate.operate_panel import SPEED_LATER
from rigctl.boards.drum_states import FAULT_TEXT, Fault, State
from rigctl.errors import LinkLost
from tests.gui.steps import Harness, click, press_escape, wait_until

FAULT = {
    "state": int(State.FAULT_OFF),
    "fault": 1,
    "fault_words": "emergency stop pressed: release it",
}
RUN = {"state": "running", "session": "/data/2026-11-23-paper", "trials_planned": 32}


class Listener:
    """What a person in the next room hears, and what the desktop shows."""

    def __init__(self) -> None:
        self.beeps = 0
        self.notices: list[str] = []

    def beep(self) -> None:
        self.beeps += 1

    def notify(self, title: str, text: str) -> None:
        self.notices.append(f"{title}: {text}")


@pytest.fixture
def listener(harness: Harness) -> Iterator[Listener]:
    """Yield a listener at the window's alarms."""
    listener, alarms = Listener(), harness.window.drum.alarms
    before, alarms.announcer = alarms.announcer, Announcer(listener.beep, listener.notify)
    yield listener
    alarms.announcer.silence()
    alarms.announcer = before


def test_a_stop_that_the_setup_asks_for_is_no_alarm(harness: Harness, listener: Listener) -> None:
    window = harness.window
    harness.update(setup={"parts": [{"name": "stop"}], "checking": "stop"}, **FAULT)
    assert window.drum.alarms.strip.isHidden() and listener.beeps == 0
    assert window.toolbar.state_words.text() == "emergency stop"
    assert window.toolbar.state.property("level") != "bad"
    harness.update(setup={"parts": [{"name": "stop"}]}, **FAULT)
    assert window.drum.alarms.strip.isVisible() and listener.beeps == 1


def test_a_fault_alarms_by_strip_heading_title_sound_and_notice(
    harness: Harness, listener: Listener
) -> None:
    harness.update(run=RUN, **FAULT)
    window = harness.window
    strip, announcer = window.drum.alarms.strip, window.drum.alarms.announcer
    assert strip.isVisible() and strip.title.text() == "FAULT"
    assert "2026-11-23-paper (0 of 32 trials)" in strip.text.text()
    assert window.windowTitle().startswith("FAULT – rigctl")
    assert window.toolbar.property("alarm") == "on"
    assert listener.beeps == 1 and listener.notices[0].startswith("FAULT: Emergency stop")
    assert announcer.is_sounding
    harness.update(**FAULT)
    assert listener.beeps == 1 and len(listener.notices) == 1
    click(strip.silence)
    assert not announcer.is_sounding and strip.isVisible() and not strip.silence.isVisible()
    harness.update(state=int(State.IDLE), fault=0, fault_words="")
    assert strip.isHidden() and window.windowTitle() == "rigctl: virtual, simulated"
    assert window.toolbar.property("alarm") == "off"


def test_clear_offers_the_lift_of_a_drum_that_is_still_in_contact(harness: Harness) -> None:
    strip = harness.window.drum.alarms.strip
    harness.update(contact_may_stand=True, **FAULT)
    assert "still in contact with the sensor" in strip.text.text()
    assert harness.window.toolbar.state_words.text() == "still in contact"
    assert strip.act.text() == "Clear fault"
    click(strip.act)
    harness.update(state=int(State.IDLE), fault=0)
    assert harness.window.toolbar.state_words.text() == "still in contact"
    assert (strip.title.text(), strip.act.text()) == ("STILL IN CONTACT", "Lift the drum")
    click(strip.act)
    assert harness.engine.commands == ["clear_fault", "arm"]
    harness.update(state=int(State.ARMED), contact_may_stand=False)
    assert strip.isHidden()


def test_a_fault_is_not_cleared_while_the_emergency_stop_is_pressed(harness: Harness) -> None:
    strip = harness.window.drum.alarms.strip
    button = harness.window.operate_panel.buttons["clear_fault"]
    harness.update(estop_pressed=True, **FAULT)
    for clear in (strip.act, button):
        assert not clear.isEnabled() and "Release the emergency stop" in clear.toolTip()
    harness.update(estop_pressed=False)
    for clear in (strip.act, button):
        assert clear.isEnabled() and "Release" not in clear.toolTip()


def test_a_drum_that_does_not_answer_comes_before_its_fault(harness: Harness) -> None:
    strip = harness.window.drum.alarms.strip
    harness.update(drum_connected=False, **FAULT)
    assert strip.title.text() == "BOARD LOST (and 1 more)" and not strip.act.isVisible()
    harness.update(drum_connected=True, taxels_connected=False, **FAULT)
    assert strip.title.text() == "FAULT (and 1 more)" and strip.act.text() == "Clear fault"


def test_an_untouched_drum_is_no_alarm_after_a_boot(harness: Harness) -> None:
    harness.update(state=int(State.IDLE), contact_may_stand=True, tared=False)
    assert harness.window.drum.alarms.strip.isHidden()


def test_a_lost_engine_leaves_session_and_way_on_on_the_screen(
    harness: Harness, listener: Listener
) -> None:
    harness.update(run={**RUN, "trials_committed": 12})
    harness.engine.failure = LinkLost("the engine ended (it closed the connection)")
    harness.window.poll()
    strip = harness.window.drum.alarms.strip
    assert strip.isVisible() and strip.title.text() == "ENGINE LOST"
    text = strip.text.text()
    assert "2026-11-23-paper (12 of 32 trials) is kept" in text
    assert "Connect" in text and "Continue a session" in text
    assert listener.notices and harness.window.windowTitle() == "ENGINE LOST – rigctl"
    click(strip.dismiss)
    assert strip.isHidden() and harness.window.windowTitle() == "rigctl"


def test_a_failed_run_stays_until_it_is_dismissed(harness: Harness, listener: Listener) -> None:
    harness.update(run={**RUN, "state": "failed", "text": "the disk is full"})
    strip = harness.window.drum.alarms.strip
    assert strip.title.text() == "RUN FAILED" and "The disk is full" in strip.text.text()
    assert "Continue a session" in strip.text.text()
    click(strip.dismiss)
    harness.update()
    assert strip.isHidden() and len(listener.notices) == 1


def test_what_a_cleared_fault_asked_for_is_asked_no_more(harness: Harness) -> None:
    """A run that failed by a fault told for hours to release the stop and to clear the fault."""
    sentence = FAULT_TEXT[Fault.ESTOP]
    failed = {**RUN, "state": "failed", "text": sentence}
    harness.update(run=failed, **FAULT)
    window = harness.window
    strip, state, box = (
        window.drum.alarms.strip,
        window.protocol_panel.state,
        window.operate_panel.bring_up,
    )
    assert "then clear the fault" in state.text()
    assert box.missing.text() == "Before approach: clear the fault" and not box.next.isEnabled()
    harness.update(state=int(State.IDLE), fault=0, fault_words="no fault")
    cause = "Emergency stop pressed or its wire broken"
    assert state.text() == cause
    assert strip.title.text() == "RUN FAILED" and strip.text.text().startswith(f"{cause}. 2026")
    assert box.missing.text() == "Before approach: arm"
    harness.update(run={"state": "idle", "session": None, "text": "", "trials_planned": 0})


def test_what_to_do_goes_with_the_engine(harness: Harness) -> None:
    """The panel told for good that the drum turns, and which steps of the bring-up are next."""
    panel, words = harness.window.operate_panel, harness.window.toolbar.state_words
    harness.update(state=int(State.RUN))
    assert panel.set_points.allowed.text() == SPEED_LATER
    harness.engine.failure = LinkLost("the engine ended (it closed the connection): start it again")
    harness.window.poll()
    assert panel.set_points.allowed.text().startswith("Allowed: ")
    assert panel.bring_up.missing.text() == "No drum is connected"
    assert "start it again" in words.toolTip()
    harness.engine.failure = None
    harness.window.toolbar.show_connecting()
    assert "start it again" not in words.toolTip()
    harness.window.toolbar.show_disconnected("not connected")


def test_nobody_arms_a_drum_that_a_run_brings_up(harness: Harness) -> None:
    harness.update(run={"state": "paused", "reasons": ["operator"]}, tared=False)
    missing = harness.window.operate_panel.bring_up.missing
    assert missing.text() == "The run brings the drum up by itself"
    harness.update(run={"state": "idle", "reasons": []}, tared=True)


def test_a_question_sounds_once_and_is_in_the_title(harness: Harness, listener: Listener) -> None:
    prompt = {"id": 3, "text": "Mount plate B, then confirm.", "texture": "B"}
    harness.update(run={"state": "prompt", "prompt": prompt})
    harness.update()
    assert listener.beeps == 1
    assert listener.notices == ["The run waits for you: Mount plate B, then confirm."]
    assert harness.window.windowTitle().startswith("WAITS FOR YOU – ")


def test_the_sound_can_be_switched_off_for_good(harness: Harness) -> None:
    window = harness.window
    announcer = window.drum.alarms.announcer
    (action,) = [a for a in window.menuBar().actions() if a.text() == "&Rig"]
    menu = action.menu()
    assert isinstance(menu, QMenu)
    (sound,) = [a for a in menu.actions() if "sound" in a.text()]
    assert sound.isChecked()
    sound.trigger()
    assert window.settings.value("alarm_sound", True) is False and not announcer.sounds
    listener = Listener()
    quiet = Announcer(listener.beep, listener.notify)
    quiet.sounds = False
    quiet.announce("FAULT", "emergency stop pressed", repeats=False)
    assert listener.beeps == 0 and listener.notices == ["FAULT: emergency stop pressed"]
    sound.trigger()
    assert announcer.sounds


def test_the_desktop_says_that_a_run_is_done_once(harness: Harness, listener: Listener) -> None:
    over = {**RUN, "state": "done", "text": "every trial is committed", "trials_committed": 32}
    harness.update(run=over)
    assert listener.notices == []  # it was over when the window came
    harness.update(run=RUN)
    for _ in range(2):
        harness.update(run=over)
    said = "The run is done: Every trial is committed. 2026-11-23-paper (32 of 32 trials)."
    assert listener.notices == [said] and listener.beeps == 1


def test_a_pause_that_nobody_asked_for_is_told_once(harness: Harness, listener: Listener) -> None:
    harness.update(run={**RUN, "state": "paused", "reasons": ["operator"]})
    assert listener.notices == []
    for _ in range(2):
        harness.update(run={**RUN, "state": "paused", "reasons": ["operator", "disk"]})
    said = "The run is paused: The disk is too full or too slow. 2026-11-23-paper (0 of 32 trials)."
    assert listener.notices == [said]


def test_a_run_that_records_nothing_for_a_minute_is_told(
    harness: Harness, listener: Listener
) -> None:
    nothing = {"recording": {"active": False}, "run": RUN}
    harness.update(at_s=500.0, **nothing)  # joined in the middle
    harness.update(at_s=559.0, **nothing)
    harness.update(at_s=560.0, run=RUN, recording={"active": True})
    harness.update(at_s=619.0, **nothing)
    assert listener.notices == []
    for at_s in (621.0, 622.0):
        harness.update(at_s=at_s, **nothing)
    said = "Nothing is recorded: For a minute 2026-11-23-paper (0 of 32 trials) has got no samples"
    assert [notice.partition(":")[0] for notice in listener.notices] == ["Nothing is recorded"]
    assert listener.notices[0].startswith(said)


def test_desktop_notices_can_be_switched_off_for_good(harness: Harness) -> None:
    window = harness.window
    (action,) = [a for a in window.menuBar().actions() if a.text() == "&Rig"]
    menu = action.menu()
    assert isinstance(menu, QMenu)
    (notices,) = [a for a in menu.actions() if "notices" in a.text()]
    assert notices.isChecked()
    notices.trigger()
    assert window.settings.value("desktop_notices", True) is False
    assert not window.drum.alarms.announcer.notices
    listener = Listener()
    silent = Announcer(listener.beep, listener.notify)
    silent.notices = False
    silent.announce("FAULT", "emergency stop pressed", repeats=False)
    assert listener.beeps == 1 and listener.notices == []


def test_a_command_that_stop_ended_is_no_refusal(harness: Harness) -> None:
    harness.update(state=int(State.HOLD))
    harness.engine.replies = False
    click(harness.window.operate_panel.buttons["run"])
    click(harness.window.toolbar.stop_button)
    harness.engine.refuse_all("the travel was interrupted: a stop or another command came")
    harness.window.poll()
    log = harness.window.event_log.toPlainText()
    assert "run: ended by STOP" in log and "refused  run" not in log


def test_one_press_of_escape_in_an_open_list_is_one_stop(harness: Harness) -> None:
    harness.update(state=int(State.RUN))
    unit = harness.window.live_page.bar.unit
    unit.showPopup()
    press_escape(unit.view())
    unit.hidePopup()
    wait_until(lambda: QApplication.activePopupWidget() is None)
    assert harness.engine.commands == ["stop"]
    QTest.qWait(10)  # the next press is another turn of the event loop
    press_escape(harness.window)
    assert harness.engine.commands == ["stop", "stop"]
