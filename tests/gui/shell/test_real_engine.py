"""The window with a real engine and the virtual rig: manual commands, then a protocol."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.live.live_page import SAVE
from gui.operate.bench_controls import AS_DRAWN, WRONGLY
from gui.operate.operate_panel import READY, BringUpBox
from gui.shell.main_window import MainWindow
from gui.widgets.labels import Level
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, running_engines, runtime_folder
from rigctl.engine.rpc.messages import LslScope
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.gui.running_engine import ridges
from tests.gui.steps import click, own_window, press_escape, wait_until

TIMEOUT_MS = 120_000
RIDGES = ridges("ridges", 3)
PEOPLE = {"operator": "Jörg", "sensor": "batch 7", "project": "pilot", "notes": "new skin"}


@pytest.fixture(scope="module")
def window(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[MainWindow]:
    """Yield a window whose Connect button has started an engine."""
    with pytest.MonkeyPatch.context() as patch, own_window() as window:
        patch.setenv(FOLDER_VARIABLE, str(tmp_path_factory.mktemp("runtime")))
        window.show()
        click(window.toolbar.connect_button)
        _wait(window, State.IDLE)
        yield window


@pytest.fixture(autouse=True)
def log_of_a_failure(window: MainWindow) -> Iterator[None]:
    """Print what the window says; pytest shows it beside a failure."""
    yield
    print(window.event_log.toPlainText(), window.engine_link.status, sep="\n")


def _wait(window: MainWindow, *states: State) -> None:
    wait_until(lambda: window.engine_link.status.state in states, TIMEOUT_MS)


def test_the_menu_streams_to_other_programs_and_shows_who_sees_it(window: MainWindow) -> None:
    pytest.importorskip("pylsl", reason="its wheels have liblsl for x86-64 and ARM Macs only")
    drum = [a for menu, a in window.menus.actions() if menu == "Rig → Stream over LSL"]
    finger = [a for menu, a in window.menus.actions() if menu == "Rig → Finger → Stream over LSL"]
    assert [action.text() for action in drum if action.isChecked()] == ["O&ff"]
    assert not any(action.isEnabled() for action in finger), "its engine is not connected"
    off, computer, _ = drum
    computer.trigger()
    wait_until(lambda: "rigctl virtual spikes" in window.event_log.toPlainText(), TIMEOUT_MS)
    assert window.engine_link.status.lsl is LslScope.COMPUTER and computer.isChecked()
    off.trigger()
    wait_until(lambda: window.engine_link.status.lsl is LslScope.OFF, TIMEOUT_MS)
    assert off.isChecked()


def _arm(window: MainWindow) -> None:
    """Arm the drum unless it is armed already."""
    if window.engine_link.status.state is State.IDLE:
        click(window.operate_panel.buttons["arm"])
    _wait(window, State.ARMED)


def test_manual_run_stops_by_the_button(window: MainWindow) -> None:
    buttons = window.operate_panel.buttons
    _arm(window)
    window.operate_panel.speed.setValue(40.0)
    click(window.operate_panel.set_button)
    wait_until(lambda: window.operate_panel.set_points.drum_speed.text() == "40.0 mm/s")
    assert not buttons["approach"].isEnabled() and "Tare first" in buttons["approach"].toolTip()
    click(buttons["tare"])
    wait_until(buttons["approach"].isEnabled)
    click(buttons["approach"])
    _wait(window, State.HOLD)
    click(buttons["run"])
    _wait(window, State.RUN)
    wait_until(lambda: window.engine_link.status.speed_mm_s > 20)
    click(window.toolbar.stop_button)
    _wait(window, State.RETRACT, State.ARMED)
    _wait(window, State.ARMED)
    assert window.engine_link.status.speed_mm_s == 0
    assert len(window.live_plots.data.history) > 1000
    assert window.live_plots.rate_bars.rates_hz.shape == (36,)


def test_drum_jogs_by_mouse_and_keys_and_stops(window: MainWindow) -> None:
    jog, link = window.operate_panel.jog, window.engine_link
    _arm(window)
    turn_steps, step_mm = 12800, 0.03125

    def moved(before: int) -> float:
        return (link.status.steps - before) * step_mm

    def has_moved(before: int, by_mm: float) -> bool:
        return moved(before) == by_mm

    for mm in (10, -1):
        before = link.status.steps
        wait_until(jog.buttons[mm].isEnabled)
        click(jog.buttons[mm])
        assert not jog.buttons[mm].isEnabled() and "the drum is moving" in jog.buttons[mm].toolTip()
        wait_until(partial(has_moved, before, mm))
    before = link.status.steps
    wait_until(jog.buttons[1].isEnabled)
    QTest.keyClick(window, Qt.Key.Key_Right, Qt.KeyboardModifier.AltModifier)
    wait_until(lambda: moved(before) == 1)
    _wait(window, State.ARMED)
    link.request("jog", mm=turn_steps * step_mm)
    wait_until(lambda: link.status.speed_mm_s > 100)
    press_escape(window)
    _wait(window, State.RETRACT, State.ARMED)
    _wait(window, State.ARMED)
    assert 1 < moved(before) < 300 and link.status.speed_mm_s == 0


def test_refusal_of_the_board_is_a_sentence(window: MainWindow) -> None:
    window.engine_link.request("run")
    wait_until(lambda: "refused  run: " in window.event_log.toPlainText())
    assert "Traceback" not in window.event_log.toPlainText()


def test_protocol_runs_to_disk_and_stops_by_escape(window: MainWindow, tmp_path: Path) -> None:
    path = tmp_path / "ridges.toml"
    path.write_text(RIDGES)
    window.show_panel("protocol")
    panel, status = window.protocol_panel, window.engine_link
    panel.add_protocol(str(path))
    panel.out.setText(str(tmp_path))
    for field, text in PEOPLE.items():
        {**panel.form.about, "notes": panel.form.notes}[field].setText(text)
    wait_until(panel.buttons["Start"].isEnabled, TIMEOUT_MS)
    _queue(window)
    click(panel.buttons["Start"])
    wait_until(window.prompt_panel.isVisible, TIMEOUT_MS)
    click(window.prompt_panel.confirm)
    wait_until(lambda: status.status.run.trials_committed == 1, TIMEOUT_MS)
    wait_until(lambda: window.toolbar.recording_lamp.level is Level.OK)
    _wait(window, State.RUN)
    press_escape(panel.out)
    wait_until(lambda: status.status.run.state == "aborted", TIMEOUT_MS)
    assert panel.state.text() == "Stopped by this window: committed trials are kept"
    assert "stopped by this window" in window.event_log.toPlainText()
    with Session.open(Path(status.status.run.session)) as session:
        assert session.trials["verdict"].tolist()[0] == "committed"
        assert np.all(session.window(0).flags & 1)
        assert session.header.operator == "Jörg" and session.header.sensor == "batch 7"
        assert (session.header.project, session.header.plate_lot) == ("pilot", "")
        assert [note.text for note in session.notes] == ["new skin"]
    wait_until(lambda: window.toolbar.recording_lamp.level is Level.OFF)
    session_folder = Path(status.status.run.session)
    _start_queued(window, session_folder)
    _queue(window)
    _continue(window, session_folder)
    _kill_engine(window, session_folder)
    _open_again(window, session_folder)
    assert status.status.run.trials_committed == 2 and status.status.run.trials_planned == 3
    click(window.prompt_panel.abort)
    wait_until(lambda: status.status.run.state == "aborted", TIMEOUT_MS)
    with Session.open(session_folder) as session:
        assert len(session.committed()) == 2


def _queue(window: MainWindow) -> None:
    """Add a run to the queue."""
    queue = window.protocol_panel.queue
    click(queue.add_button)
    wait_until(lambda: queue.list.count() == 1, TIMEOUT_MS)


def _start_queued(window: MainWindow, before: Path) -> None:
    """Start the run that waits in the queue since the one before it was stopped, and abort it."""
    queue, link = window.protocol_panel.queue, window.engine_link
    assert "was not done (stopped by this window)" in queue.waits_for.text()
    assert queue.list.count() == 1
    wait_until(queue.next_button.isEnabled, TIMEOUT_MS)
    click(queue.next_button)
    wait_until(lambda: queue.list.count() == 0 and window.prompt_panel.isVisible(), TIMEOUT_MS)
    session = Path(link.status.run.session or "")
    assert session.parent == before.parent and session != before
    click(window.prompt_panel.abort)
    wait_until(lambda: link.status.run.state == "aborted", TIMEOUT_MS)


def _continue(window: MainWindow, session: Path) -> None:
    """Continue the interrupted session for one more trial."""
    _open_again(window, session)
    click(window.prompt_panel.confirm)
    run = window.engine_link
    wait_until(lambda: run.status.run.trials_committed == 2, TIMEOUT_MS)


def _open_again(window: MainWindow, session: Path) -> None:
    """Continue an interrupted session through the file browser, until it asks for its plate."""
    wait_until(window.protocol_panel.continue_button.isEnabled, TIMEOUT_MS)
    click(window.protocol_panel.continue_button)
    assert window.file_browser.dialog is not None
    window.file_browser.dialog.fileSelected.emit(str(session))
    window.file_browser.dismiss()
    wait_until(window.prompt_panel.isVisible, TIMEOUT_MS)
    last_trial = window.health_strip.cells["trial"].value
    assert last_trial.text() == "–", "the trials before were recorded in another sitting"


def _kill_engine(window: MainWindow, session: Path) -> None:
    """Kill the engine in mid-run, read the alarm, and connect again."""
    (engine,) = running_engines(runtime_folder())
    os.kill(engine.pid, signal.SIGKILL)
    strip, plate = window.drum.alarms.strip, window.operate_panel.bench.plate
    wait_until(lambda: strip.isVisible() and strip.title.text() == "ENGINE LOST", TIMEOUT_MS)
    assert f"{session.name} (2 of 3 trials) is kept" in strip.text.text()
    assert "Continue a session" in strip.text.text()
    assert "if the engine has ended, so has its queue: ridges" in window.event_log.toPlainText()
    assert window.windowTitle().startswith("ENGINE LOST")
    wait_until(lambda: window.toolbar.connect_button.text() == "Connect", TIMEOUT_MS)
    click(window.toolbar.connect_button)
    _wait(window, State.IDLE)
    wait_until(strip.isHidden)
    assert plate.currentData() == window.engine_link.status.texture


def test_unplugged_board_is_reported(window: MainWindow) -> None:
    bench = window.operate_panel.bench
    window.show_panel("operate")
    bench.fault.setCurrentText("Unplug the taxels")
    click(bench.inject)
    wait_until(lambda: not window.engine_link.status.taxels_connected, TIMEOUT_MS)
    assert window.health_strip.cells["rate"].lamp.level is Level.BAD
    bench.fault.setCurrentText("Plug in the taxels")
    click(bench.inject)
    wait_until(lambda: window.engine_link.status.taxels_connected, TIMEOUT_MS)


def test_wirings_are_switched_while_the_rig_runs(window: MainWindow) -> None:
    bench, name = window.operate_panel.bench, "potentiometer reversed"
    before_um = window.engine_link.status.actuator_position_um
    window.show_panel("operate")
    bench.wiring.setCurrentText(name)
    assert bench.wire.text() == WRONGLY
    click(bench.wire)
    wait_until(lambda: bench.wire.text() == AS_DRAWN, TIMEOUT_MS)
    assert window.engine_link.status.wrong_wirings == (name,)
    assert f"bench: {WRONGLY}: {name}" in window.event_log.toPlainText()
    reversed_um = 50_000 - before_um
    wait_until(lambda: abs(_position_um(window) - reversed_um) < 200, TIMEOUT_MS)
    click(bench.wire)
    wait_until(lambda: abs(_position_um(window) - before_um) < 200, TIMEOUT_MS)
    assert window.engine_link.status.wrong_wirings == ()


def _position_um(window: MainWindow) -> int:
    return window.engine_link.status.actuator_position_um


def _inject(window: MainWindow, fault: str) -> None:
    bench = window.operate_panel.bench
    bench.fault.setCurrentText(fault)
    click(bench.inject)


def _bring_up(window: MainWindow) -> None:
    """Press Next until the drum can approach."""
    box = window.operate_panel.bring_up
    while box.missing.text() != READY:
        before = box.next.text()
        wait_until(box.next.isEnabled, TIMEOUT_MS)
        click(box.next)
        wait_until(partial(_is_other, box, before), TIMEOUT_MS)


def _is_other(box: BringUpBox, before: str) -> bool:
    return box.next.text() != before or box.missing.text() == READY


def test_a_drum_that_an_estop_left_in_contact_is_lifted_from_the_strip(window: MainWindow) -> None:
    panel, strip = window.operate_panel, window.drum.alarms.strip
    window.show_panel("operate")
    _bring_up(window)
    wait_until(panel.buttons["approach"].isEnabled, TIMEOUT_MS)
    click(panel.buttons["approach"])
    _wait(window, State.HOLD)
    _inject(window, "Press the E-stop")
    wait_until(lambda: strip.isVisible() and strip.title.text() == "FAULT", TIMEOUT_MS)
    assert "still in contact with the sensor" in strip.text.text()
    _inject(window, "Release the E-stop")
    wait_until(lambda: strip.act.isEnabled() and strip.act.text() == "Clear fault", TIMEOUT_MS)
    click(strip.act)
    wait_until(lambda: strip.act.text() == "Lift the drum", TIMEOUT_MS)
    assert window.toolbar.state_words.text() == "still in contact"
    assert not panel.bench.plate.isEnabled() and not panel.buttons["tare"].isEnabled()
    click(strip.act)
    _wait(window, State.ARMED)
    wait_until(strip.isHidden)
    assert "approach: the force is reached" in window.event_log.toPlainText()


def test_hand_work_becomes_a_session_that_verifies(window: MainWindow, tmp_path: Path) -> None:
    box = window.operate_panel.record_box
    box.folder.setText(str(tmp_path))
    box.note.setText("a quick look")
    click(box.button)
    wait_until(lambda: window.engine_link.status.recording.samples_on_disk > 1000, TIMEOUT_MS)
    wait_until(lambda: window.toolbar.recording_lamp.level is Level.OK, TIMEOUT_MS)
    _look_back(window, tmp_path.with_name("pictures"))
    click(box.button)
    wait_until(lambda: box.button.text() == "Record", TIMEOUT_MS)
    (folder,) = tmp_path.iterdir()
    assert verify(folder).problems == []


def _look_back(window: MainWindow, pictures: Path) -> None:
    """Pause and look back while the recording goes on, save what is seen, and follow again."""
    page, link = window.live_page, window.engine_link
    navigation, graphics = page.plots.navigation, page.plots.graphics
    click(page.bar.pause)
    QTest.keyClick(graphics, Qt.Key.Key_Home)
    seen, before = navigation.window, link.status.recording.samples_on_disk
    wait_until(lambda: link.status.recording.samples_on_disk > before + 300, TIMEOUT_MS)
    assert navigation.window == seen and "ago" in page.bar.place.text()
    QTest.keyClick(graphics, Qt.Key.Key_Right, Qt.KeyboardModifier.ControlModifier)
    assert page.cursor_label.text().startswith("Cursor ")
    page.save_strip.folder.setText(str(pictures))
    click(page.bar.buttons[SAVE])
    click(page.save_strip.table)
    wait_until(lambda: f"saved {pictures}" in window.event_log.toPlainText(), TIMEOUT_MS)
    click(page.bar.buttons[SAVE])
    click(page.bar.pause)
    wait_until(lambda: navigation.window.right > seen.right, TIMEOUT_MS)


def test_an_unplugged_drum_turns_grey_and_comes_back(window: MainWindow) -> None:
    covers, strip = window.live_plots.stale_covers, window.drum.alarms.strip
    _inject(window, "Unplug the drum")
    wait_until(lambda: window.toolbar.state.property("level") == "stale", TIMEOUT_MS)
    wait_until(lambda: covers.force.isVisible() and covers.drum.isVisible(), TIMEOUT_MS)
    wait_until(lambda: strip.title.text() == "BOARD LOST", TIMEOUT_MS)
    assert not covers.taxels[0].isVisible()
    _inject(window, "Plug in the drum")
    wait_until(lambda: window.engine_link.status.drum_connected, TIMEOUT_MS)
    wait_until(lambda: not covers.drum.isVisible(), TIMEOUT_MS)
