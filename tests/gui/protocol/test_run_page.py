"""The page of a run: what is planned, what came in, notes, marks, repeats and queued runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.protocol.protocol_panel import ProtocolPanel
from gui.protocol.run_tasks import BAD, COMMITTED, REPEATED, TRIAL_COLUMNS
from gui.shell.user_settings import UserSettings, WindowMemory
from rigctl.engine.rpc.messages import QueuedRunStatus, QueueStatus
from rigctl.engine.run_queue import QueuedRun
from rigctl.errors import LinkLost
from rigctl.session.session import Session
from rigctl.values import Verdict
from tests.gui.ended_early import record_early_ends
from tests.gui.protocol.test_protocol_panel import RUN, open_panel
from tests.gui.steps import Harness, click, wait_until
from tests.session.building import SyntheticRig, plan, record_plan, record_repeats, recorder

MEAN_FORCE, LOST = TRIAL_COLUMNS.index("Mean force\n(g)"), TRIAL_COLUMNS.index("Lost\nsamples")


@pytest.fixture
def panel(harness: Harness) -> Iterator[ProtocolPanel]:
    panel = open_panel(harness)
    panel.form.operator.setText("Jörg")
    if not panel.shows_page:
        click(panel.page_button)
    yield panel
    click(panel.page_button)
    for field in panel.form.about.values():
        field.clear()
    panel.page.show_session("")


@pytest.fixture
def recorded(harness: Harness, panel: ProtocolPanel, tmp_path: Path) -> Path:
    """Return a session whose run the engine reports as paused."""
    session = tmp_path / "recorded"
    record_plan(session)
    run = {**RUN, "state": "paused", "trials_planned": 8, "trials_committed": 8}
    harness.update(run={**run, "session": str(session)})
    wait_attempts(harness, 8)
    return session


def wait_attempts(harness: Harness, count: int) -> None:
    def has_them() -> bool:
        harness.update()
        return len(harness.window.protocol_panel.page.attempts.rows) == count

    wait_until(has_them)


def verdicts(panel: ProtocolPanel) -> list[str]:
    return [row.verdict for row in panel.page.attempts.rows]


def write(panel: ProtocolPanel, text: str) -> None:
    panel.page.text.clear()
    QTest.keyClicks(panel.page.text, text)


def test_a_plan_shows_conditions_and_order_before_the_start(
    harness: Harness, panel: ProtocolPanel
) -> None:
    assert panel.form.description.text().startswith("Four textures, two speeds")
    rows = {name: row.text() for name, row in panel.plan_rows.items()}
    assert rows["Plates"] == "A B D L"
    assert (rows["Speeds"], rows["Forces"]) == ("60, 120 mm/s", "250, 500 g")
    assert rows["Order"] == "plate by plate, forces, speeds, repeats, 2 of each"
    assert "with plate changes" in rows["Duration"] and ":" in rows["Would finish"]
    page = panel.page
    page.tabs.setCurrentWidget(page.order_view)
    assert harness.window.stack.currentWidget() is page
    assert page.order.rowCount() == 32
    first = [page.order.data(page.order.index(0, column)) for column in range(7)]
    assert first == ["1", "A", "60", "250", "–", "1", "1"]


def test_a_run_says_when_it_ends_and_which_plate_is_next(
    harness: Harness, panel: ProtocolPanel
) -> None:
    plate = {"texture": "D", "trials": 3, "left_s": 95.0}
    harness.update(run={**RUN, "next_plate": plate, "session": None})
    line = "\ncircular ridges, double spacing"
    assert panel.run_rows["Next plate"].text() == f"D after 3 trials, in 1 min 35 s{line}"
    assert panel.run_rows["Finishes"].text().endswith("plus plate changes")
    assert panel.run_rows["Disk"].text() == "210 GB free"
    last = {**RUN, "next_plate": {**plate, "trials": 0, "left_s": 0.0}}
    harness.update(run=last)
    assert panel.run_rows["Next plate"].text() == f"D after this trial{line}"
    harness.update(run={**last, "state": "paused"})
    assert panel.run_rows["Next plate"].text() == f"D after the pause{line}"
    asked = {"id": 1, "text": "Mount plate D.", "texture": "D"}
    harness.update(run={**RUN, "state": "prompt", "prompt": asked, "next_plate": None})
    assert panel.run_rows["Next plate"].text() == f"D now{line}"
    harness.update(run={**RUN, "prompt": None, "next_plate": None, "session": None})
    assert panel.run_rows["Next plate"].text() == "no other plate"


def test_attempts_come_in_with_what_was_measured(
    harness: Harness, panel: ProtocolPanel, recorded: Path
) -> None:
    first = panel.page.attempts.rows[0]
    assert first.verdict == COMMITTED
    assert (first.texts[MEAN_FORCE], first.texts[LOST]) == ("250.0", "0")


def test_conditions_that_ended_early_are_named_below_the_trials(
    harness: Harness, panel: ProtocolPanel, recorded: Path, tmp_path: Path
) -> None:
    line = panel.page.early_ends
    assert not line.isVisible()
    reasons = record_early_ends(tmp_path / "early")
    run = {**RUN, "state": "running", "session": str(tmp_path / "early")}
    harness.update(run={**run, "trials_planned": 28, "trials_committed": 20})
    wait_attempts(harness, 20)
    first, *newest = line.text().split("\n")
    assert line.isVisible() and first == "Early ends: 4, the newest below"
    assert newest == [f"{reason}; 2 trials not recorded" for reason in reasons[1:]]
    assert newest[0].startswith("A, 80 mm/s, 250 g ends early after 5 trials: mean SA rate 41.25")
    record_early_ends(tmp_path / "one", conditions=1)
    harness.update(run={**run, "session": str(tmp_path / "one")})
    wait_until(lambda: line.text() == f"{reasons[0]}; 2 trials not recorded")
    panel.page.show_session("")
    assert not line.isVisible()


def test_a_trial_is_marked_bad_and_good_again(
    harness: Harness, panel: ProtocolPanel, recorded: Path
) -> None:
    page = panel.page
    assert not page.buttons["bad"].isEnabled()
    page.attempt_view.selectRow(2)
    assert page.buttons["bad"].toolTip() == "Write the note first"
    assert page.buttons["good"].toolTip() == "Choose a trial that is marked bad in the table"
    write(panel, "slipped")
    click(page.buttons["bad"])
    wait_until(lambda: verdicts(panel)[2] == BAD)
    assert page.text.text() == ""
    line = f"note  {recorded.name}, trial 3, attempt 1 marked bad: “slipped”, noted by Jörg"
    assert line in harness.window.event_log.toPlainText()
    with Session.open(recorded) as session:
        assert 3 not in session.trials["trial_id"][session.committed()]
        assert session.notes[0].author == "Jörg"
    assert page.chosen is not None and page.chosen.trial_id == 3
    write(panel, "it had not")
    assert not page.buttons["bad"].isEnabled()
    click(page.buttons["good"])
    wait_until(lambda: verdicts(panel)[2] == COMMITTED)
    assert page.notes.count() == 2 and page.notes.item(0).text().endswith("marked bad: slipped")


def test_a_repeated_trial_is_called_so_once_another_attempt_counts(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    folder, (trial, *_) = tmp_path / "growing", plan().trials
    run = {**RUN, "state": "running", "session": str(folder), "trials_planned": 8}
    with recorder(folder) as rec:
        rec.begin_part("start", trial.texture)
        source = SyntheticRig(rec)
        source.trial(trial, Verdict.REJECTED)
        rec.wait_written()
        harness.update(run={**run, "trials_committed": 0, "trials_rejected": 1})
        wait_attempts(harness, 1)
        assert verdicts(panel) == ["✗ rejected"]
        source.trial(trial, attempt=2)
        rec.wait_written()
        harness.update(run={**run, "trials_committed": 1})
        wait_attempts(harness, 2)
        assert verdicts(panel) == [f"{REPEATED}, rejected", COMMITTED]
    record_repeats(tmp_path / "repeats")
    harness.update(run={**run, "state": "done", "session": str(tmp_path / "repeats")})
    wait_attempts(harness, 10)
    assert verdicts(panel)[2:4] == [REPEATED, COMMITTED]
    assert panel.page.attempts.rows[2].texts[-1].startswith("marked bad: slipped")


def test_notes_of_a_run_go_through_its_engine(
    harness: Harness, panel: ProtocolPanel, recorded: Path
) -> None:
    write(panel, "someone leans on the table")
    QTest.keyClick(panel.page.text, Qt.Key.Key_Return)
    assert harness.engine.requests[-1] == ("note", {"text": "someone leans on the table"})
    panel.page.attempt_view.selectRow(7)
    write(panel, "the plate was dusty")
    click(panel.page.buttons["repeat"])
    arguments = {"trial_id": 8, "text": "the plate was dusty"}
    assert harness.engine.requests[-1] == ("repeat", arguments)


def test_a_key_marks_the_newest_trial_and_skip_leaves_one_out(
    harness: Harness, panel: ProtocolPanel, recorded: Path
) -> None:
    window, page = harness.window, panel.page
    window.activateWindow()
    wait_until(window.isActiveWindow)
    QTest.keyClick(page.attempt_view, Qt.Key.Key_B, Qt.KeyboardModifier.ControlModifier)
    wait_until(lambda: verdicts(panel)[7] == BAD)
    assert page.attempts.rows[7].texts[-1].startswith("marked bad")
    click(page.buttons["skip"])
    assert harness.engine.requests[-1] == ("skip", {"trial_id": 0})
    page.tabs.setCurrentWidget(page.order_view)
    page.order_view.selectRow(4)
    click(page.buttons["skip"])
    number = int(page.order.index(4, 0).data())
    assert harness.engine.requests[-1] == ("skip", {"trial_id": number})
    page.tabs.setCurrentWidget(page.attempt_view)
    page.attempt_view.selectRow(0)
    write(panel, "a scratch on the plate")
    click(page.buttons["on_trial"])
    wait_until(lambda: page.attempts.rows[0].texts[-1] == "a scratch on the plate")


def test_notes_can_be_added_long_after_the_run(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    session = tmp_path / "old"
    record_plan(session)
    click(panel.page.open_button)
    dialog = harness.window.file_browser.dialog
    assert dialog is not None
    dialog.fileSelected.emit(str(session))
    harness.window.file_browser.dismiss()
    wait_attempts(harness, 8)
    assert not panel.page.buttons["repeat"].isEnabled()
    write(panel, "the sensor was replaced afterwards")
    click(panel.page.buttons["note"])
    wait_until(lambda: panel.page.notes.count() == 1)
    assert "old: “the sensor was replaced afterwards”" in harness.window.event_log.toPlainText()
    assert "note" not in harness.engine.commands


def test_a_folder_that_is_no_session_says_so(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    (tmp_path / "part-0001.h5").write_text("torn")
    panel.page.open_session(str(tmp_path))
    wait_until(panel.page.problem.isVisible)
    assert "part-0001.h5" in panel.page.problem.text()


def queue_status(*names: str, waits_for: str = "", due_s: float | None = None) -> dict[str, Any]:
    """Return a queue as the engine sends it; the number of a run is that of its first letter."""
    runs = [QueuedRunStatus(ord(name[0]), name, 3, 32, 4, 502.0, due_s) for name in names]
    return asdict(QueueStatus(tuple(runs), waits_for))


def test_runs_are_queued_in_the_engine_with_what_is_planned_of_them(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    panel.out.setText(str(tmp_path))
    harness.update()
    click(panel.queue.add_button)
    command, args = harness.engine.requests[-1]
    assert command == "enqueue" and (args["operator"], args["out"]) == ("Jörg", str(tmp_path))
    assert str(args["trials"]) == panel.plan_rows["Trials"].text()
    assert str(args["plate_changes"]) == panel.plan_rows["Plate changes"].text()
    assert args["duration_s"] > 60 * args["plate_changes"]
    msgspec.convert(args, QueuedRun)  # as the engine reads it
    assert panel.queue.list.count() == 0, "the engine says what waits"


def test_the_queue_shows_what_waits_and_moves_and_removes_it(
    harness: Harness, panel: ProtocolPanel
) -> None:
    queue = panel.queue
    harness.update(queue=queue_status("a", "b", waits_for="the last run was not done: look at it"))
    QApplication.processEvents()
    for part in (queue.waits_for, queue.next_button):  # nobody has to scroll for it
        assert part.isVisible() and part.visibleRegion().boundingRect() == part.rect()
    assert queue.waits_for.text() == "Waits: the last run was not done: look at it."
    assert queue.list.item(0).text() == "1. a, seed 3: 32 trials, 4 plate changes\n8 min 22 s"
    queue.list.setCurrentRow(1)
    assert not queue.down_button.isEnabled()
    click(queue.up_button)
    harness.update(queue=queue_status("b", "a", due_s=60.0))
    assert queue.list.currentRow() == 0 and not queue.up_button.isEnabled(), "it stays chosen"
    assert "\ndue " in queue.list.item(0).text() and ", over " in queue.list.item(0).text()
    click(queue.down_button)
    click(queue.remove_button)
    click(queue.next_button)
    assert harness.engine.requests[-4:] == [
        ("move_queued", {"number": ord("b"), "places": -1}),
        ("move_queued", {"number": ord("b"), "places": 1}),
        ("dequeue", {"number": ord("b")}),
        ("start_queued", {}),
    ]
    harness.update(run={"state": "running"})
    assert not queue.next_button.isEnabled() and queue.remove_button.isEnabled()
    harness.update(run={"state": "idle"}, queue=asdict(QueueStatus()))
    assert not queue.waits_for.isVisible() and not queue.remove_button.isEnabled()


@pytest.mark.parametrize(
    ("failure", "sentence"),
    [
        ("", "the engine goes on with its queue: a, b"),
        ("the engine ended", "if the engine has ended, so has its queue: a, b"),
    ],
)
def test_a_window_without_its_engine_says_what_became_of_the_queue(
    harness: Harness, panel: ProtocolPanel, failure: str, sentence: str
) -> None:
    harness.update(queue=queue_status("a", "b"))
    if failure:
        harness.engine.failure = LinkLost(failure)
        harness.window.poll()
    else:
        harness.window.engine_link.close()
    assert sentence in harness.window.event_log.toPlainText()
    assert panel.queue.list.count() == 0


def test_the_next_window_knows_folder_operator_and_sensor(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    window = harness.window
    memory = WindowMemory(UserSettings(tmp_path / "window.ini"), window, window.docks)
    panel.form.operator.clear()
    memory.keep_texts(panel.form.remembered)
    panel.form.operator.setText("Jörg")
    panel.out.setText(str(tmp_path))
    panel.form.sensor.setText("batch 7")
    for name, text in (("plate_lot", "PLA 3"), ("project", "pilot"), ("remarks", "cold room")):
        panel.form.about[name].setText(text)
    panel.form.notes.setText("new skin")
    panel.form.own.show_asked(["skin temperature", "cleaned with"])
    panel.form.own.fields["cleaned with"].setText("ethanol")
    harness.update()
    wait_until(panel.buttons["Start"].isEnabled)
    click(panel.buttons["Start"])
    _, arguments = harness.engine.requests[-1]
    assert (arguments["operator"], arguments["sensor"]) == ("Jörg", "batch 7")
    said = [arguments[name] for name in ("plate_lot", "project", "remarks")]
    assert said == ["PLA 3", "pilot", "cold room"]
    assert arguments["notes"] == "new skin" and panel.form.notes.text() == ""
    assert arguments["own"] == {"cleaned with": "ethanol"}
    panel.form.own.show_asked([])
    memory.save()
    later = ProtocolPanel()
    settings = UserSettings(tmp_path / "window.ini")
    WindowMemory(settings, window, window.docks).keep_texts(later.form.remembered)
    assert later.out.text() == str(tmp_path)
    assert (later.form.operator.text(), later.form.sensor.text()) == ("Jörg", "batch 7")
    assert later.form.about["plate_lot"].text() == "PLA 3"
    later.form.own.show_asked(["cleaned with"])
    assert later.form.own.fields["cleaned with"].text() == "ethanol"
