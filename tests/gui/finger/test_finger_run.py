"""The finger's run from the window: start, prompts, pause, models, loss, STOP."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from PySide6.QtTest import QTest

from gui.analysis.task_values import FingerSessionInfo
from gui.finger.finger_tab import FingerSetupForm
from gui.link.engine_link import FingerEngineSpec
from gui.shell.user_settings import UserSettings, WindowMemory
from gui.widgets.labels import Level
from gui.widgets.typed_paths import NO_WHOLE_PATH
from rigctl.errors import LinkLost
from rigctl.finger.values import RUN_FIRST_SLIDE
from rigctl.values import ABOUT
from tests.gui.fake_finger import RUNNING, FakeFinger
from tests.gui.steps import FingerWindow, SharedWindow, click, press_escape, wait_until


def _start_args(finger: FingerWindow) -> list[dict[str, Any]]:
    return [args for command, args in finger.engine.requests if command == "start"]


def _models(folder: Path) -> Path:
    """Make a folder with empty models; the engine reads them, the window does not."""
    for kind in ("speed-scaled", "original"):
        (folder / f"model-{kind}.h5").touch()
    return folder


def test_training_starts_with_its_normalisation(finger: FingerWindow, tmp_path: Path) -> None:
    finger.update()
    assert "125 scans of plates A, B, D, L, N" in finger.tab.setup.plan.text()
    click(finger.tab.run_box.buttons["Start"])
    (args,) = _start_args(finger)
    assert args["stages"] == ["normalise", "train"] and args["yes"] is False
    assert Path(args["out"]).parent == tmp_path and "model" not in args


def test_what_is_said_of_a_session_is_sent_and_offered_for_the_next(
    finger: FingerWindow, tmp_path: Path
) -> None:
    setup, window = finger.tab.setup, finger.window
    memory = WindowMemory(UserSettings(tmp_path / "window.ini"), window, window.docks)
    memory.keep_texts(setup.remembered)
    said = {"operator": "Kim", "sensor": "S2", "plate_lot": "PLA 3", "project": "pilot"}
    for name, text in said.items():
        setup.about[name].clear()
        QTest.keyClicks(setup.about[name], text)
    finger.update()
    click(finger.tab.run_box.buttons["Start"])
    (args,) = _start_args(finger)
    assert {name: args[name] for name in ABOUT} == {**said, "remarks": ""}
    memory.save()
    later = FingerSetupForm()
    again = WindowMemory(UserSettings(tmp_path / "window.ini"), window, window.docks)
    again.keep_texts(later.remembered)
    assert later.said() == {**said, "remarks": ""}
    for field in setup.about.values():
        field.clear()


def test_run_without_a_model_is_refused_in_a_sentence(finger: FingerWindow) -> None:
    finger.update()
    finger.tab.setup.choose_stage("run")
    finger.tab.setup.model.setText("/nowhere")
    click(finger.tab.run_box.buttons["Start"])
    assert _start_args(finger) == []
    assert "there is no model" in finger.tab.run_box.models.text()
    assert "there is no model" in finger.window.status_line.text()
    finger.tab.setup.choose_stage("train")
    finger.tab.setup.out.setText("scans")
    click(finger.tab.run_box.buttons["Start"])
    assert _start_args(finger) == []
    assert finger.tab.run_box.models.text() == NO_WHOLE_PATH
    finger.tab.setup.out.setText("/data")
    assert finger.tab.run_box.models.text() == "", "it says no more what is mended"


def test_another_session_of_the_person_gets_another_engine(
    finger: FingerWindow, shared: SharedWindow, tmp_path: Path
) -> None:
    finger.update()
    setup = finger.tab.setup
    setup.choose_stage("run")
    setup.model.setText(str(_models(tmp_path)))
    setup.representation.setCurrentIndex(setup.representation.findData("original"))
    (tmp_path / "next").mkdir()
    first, second = finger.engine, FakeFinger(tmp_path / "next")
    shared.finger = second
    click(finger.tab.run_box.buttons["Start"])
    wait_until(lambda: "start" in second.commands)
    assert first.is_closed and "start" not in first.commands
    assert shared.finger_specs[-1] == FingerEngineSpec("virtual", 0, 1, RUN_FIRST_SLIDE)
    (args,) = (args for command, args in second.requests if command == "start")
    assert args["model"] == str(tmp_path / "model-original.h5") and args["stages"] == ["run"]


def test_prompt_is_answered_and_leaves_stop_uncovered(finger: FingerWindow) -> None:
    text = "Lay plate B under the finger, then confirm."
    prompt = {"id": 3, "text": text, "texture": "B"}
    finger.update(run={**RUNNING, "state": "prompt", "prompt": prompt})
    window, panel = finger.window, finger.tab.prompt_panel
    assert panel.isVisibleTo(window) and panel.text.text() == text
    assert finger.tab.view.task.text() == text
    place = window.toolbar.stop_button.mapTo(window, window.toolbar.stop_button.rect().center())
    assert window.childAt(place) is window.toolbar.stop_button
    click(panel.confirm)
    assert finger.engine.requests[-1] == ("answer", {"prompt_id": 3, "answer": "ok"})
    finger.update(run={"state": "running", "prompt": None})
    assert not panel.isVisibleTo(window)
    assert finger.tab.view.task.text() == "Plate B, slow: slide over the plate"


def test_pause_resume_and_abort_follow_the_run(finger: FingerWindow) -> None:
    buttons = finger.tab.run_box.buttons
    finger.update(run=RUNNING)
    assert not buttons["Start"].isEnabled() and not finger.tab.setup.isEnabled()
    click(buttons["Pause"])
    finger.update(run={"state": "paused", "reasons": ["operator"]})
    assert finger.tab.view.task.text() == "Paused: operator"
    click(buttons["Resume"])
    click(buttons["Abort"])
    assert finger.engine.commands == ["pause", "resume", "abort"]
    progress = finger.tab.run_box.rows["Progress"].text()
    assert progress == "11 of 25 scans, 1 min 10 s left"


def test_models_are_made_after_training_and_lead_to_the_calibration(
    finger: FingerWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitted: list[tuple[str, dict[str, Any]]] = []
    worker = finger.tab.worker
    monkeypatch.setattr(worker, "submit", lambda task, **args: submitted.append((task, args)))
    finger.update()
    click(finger.tab.run_box.buttons["Start"])
    before = {"state": "done", "session": str(tmp_path / "an earlier run")}
    for run in (before, {**RUNNING, "session": str(tmp_path)}):
        finger.update(run=run)
    assert submitted == []
    session = _start_args(finger)[0]["out"]
    for _ in range(3):
        finger.update(run={"state": "done", "session": session})
    args = {"session": session, "source": "", "components": 25}
    assert submitted == [("make_finger_models", args)]
    worker.finished.emit("make_finger_models", (str(tmp_path / "model-speed-scaled.h5"),))
    setup = finger.tab.setup
    assert setup.stage.currentText() == "2 Calibrate" and setup.session.value() == 1
    assert setup.model.text() == str(tmp_path)
    assert "Next: 2 Calibrate" in finger.tab.run_box.models.text()


def test_run_of_another_client_makes_no_models(
    finger: FingerWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitted: list[str] = []
    monkeypatch.setattr(finger.tab.worker, "submit", lambda task, **_: submitted.append(task))
    for state in ("running", "done"):
        finger.update(run={**RUNNING, "state": state, "session": str(tmp_path)})
    assert submitted == []
    click(finger.tab.run_box.models_button)
    assert submitted == ["make_finger_models"]


def test_a_run_that_was_stopped_is_continued_where_it_ended(
    finger: FingerWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitted: list[tuple[str, dict[str, Any]]] = []
    worker = finger.tab.worker
    monkeypatch.setattr(worker, "submit", lambda task, **args: submitted.append((task, args)))
    button = finger.tab.run_box.run_state.continue_button
    finger.update(run=RUNNING)
    assert not button.isVisible()
    finger.update(run={"state": "aborted", "session": str(tmp_path)})
    click(button)
    assert submitted == [("read_finger_session", {"path": str(tmp_path)})]


def test_session_is_continued_by_its_own_person(
    finger: FingerWindow, shared: SharedWindow, tmp_path: Path
) -> None:
    finger.update()
    info = FingerSessionInfo(str(tmp_path), ("normalise", "train"), 7, 0, 12)
    (tmp_path / "next").mkdir()
    shared.finger = FakeFinger(tmp_path / "next")
    finger.tab.worker.finished.emit("read_finger_session", info)
    wait_until(lambda: shared.finger is not None and "start" in shared.finger.commands)
    assert shared.finger_specs[-1] == FingerEngineSpec("virtual", 7, 0, 12)
    said = dict.fromkeys(ABOUT, "")
    assert shared.finger.requests[-1][1] == {"resume": str(tmp_path), "yes": False, **said}


def test_stop_reaches_the_finger(finger: FingerWindow) -> None:
    click(finger.window.toolbar.stop_button)
    press_escape(finger.tab.setup.out)
    assert finger.engine.commands == ["stop", "stop"]


def test_lost_engine_is_reported(finger: FingerWindow) -> None:
    finger.update(run=RUNNING)
    finger.engine.failure = LinkLost("the engine ended (it closed the connection)")
    finger.window.poll()
    assert "the engine ended" in finger.window.status_line.text()
    assert finger.tab.bar.connect_button.text() == "Connect"
    assert finger.tab.health.cells["rate"].lamp.level is Level.OFF
    assert finger.tab.run_box.buttons["Start"].isEnabled()


def test_silent_engine_turns_the_recording_lamp_bad(finger: FingerWindow) -> None:
    finger.update(run=RUNNING)
    lamp = finger.tab.bar.recording_display.lamp
    assert lamp.level is Level.OK
    wait_until(lambda: lamp.level is Level.BAD)
    assert "does not answer" in finger.window.event_log.toPlainText()


@pytest.mark.parametrize("device", ["finger", "tracker"])
def test_missing_device_is_named(finger: FingerWindow, device: str) -> None:
    finger.update(**{f"{device}_connected": False})
    words = finger.tab.bar.state_words.text()
    assert device in words and "not connected" in words


def test_refusal_is_a_sentence(finger: FingerWindow) -> None:
    finger.update()
    finger.engine.refusals["start"] = "the disk is full: free 1 GB"
    click(finger.tab.run_box.buttons["Start"])
    finger.window.poll()
    assert "start: the disk is full" in finger.window.status_line.text()


def test_batches_do_not_flood_the_log(finger: FingerWindow) -> None:
    finger.engine.send_batch(1, 55.0, 5.5)
    finger.engine.send_event("log", "scan 3 is given up after 5 attempts")
    finger.window.poll()
    log = finger.window.event_log.toPlainText()
    assert "given up" in log and "55 mm/s" not in log


def test_the_closing_digest_of_a_run_is_a_line_of_the_log(finger: FingerWindow) -> None:
    finger.engine.send_event("run", "every scan is committed", state="done", digest="4f" * 32)
    finger.engine.send_event("model", "a model", digest="5a" * 32)
    finger.window.poll()
    log = finger.window.event_log.toPlainText()
    assert log.count("4f" * 32) == 1
    assert "5a" * 32 not in log


def test_simulated_faults_are_for_simulated_rigs(finger: FingerWindow) -> None:
    box = finger.tab.run_box
    finger.update(run=RUNNING)
    box.fault.setCurrentIndex(box.fault.findText("Always lay plate C"))
    click(box.inject)
    injected = {"fault": "wrong_plate", "texture": "C"}
    assert finger.engine.requests[-1] == ("inject", injected)
    finger.engine.welcome["inject"] = {"injected": injected}
    click(box.inject)
    finger.window.poll()
    assert "done  bench: Always lay plate C" in finger.window.event_log.toPlainText()
    finger.update(simulated=False)
    assert not box.inject.isVisibleTo(finger.window)
    assert "SIMULATED" not in finger.tab.view.progress.text()


def test_toolbar_and_health_are_those_of_the_chosen_tab(finger: FingerWindow) -> None:
    window = finger.window
    assert finger.tab.bar.isVisibleTo(window) and not window.health_strip.isVisibleTo(window)
    window.show_panel("operate")
    QTest.qWait(20)
    assert window.toolbar.rig.isVisibleTo(window) and window.health_strip.isVisibleTo(window)
    assert not finger.tab.health.isVisibleTo(window)
