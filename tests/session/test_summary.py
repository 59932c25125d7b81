"""``rigctl info`` summarises a session and compares it with the log of the simulated world."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import create_parser
from rigctl.cli import info as command
from rigctl.errors import SessionError
from rigctl.session.ground_truth import begin_log, open_truth, trial_truths
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session, add_note
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.session.building import IDLE, PROTOCOL, RIG, header, plan, record_plan

START = (header().start_utc, header().start_loop_s)


def run(*words: str) -> int:
    return command.run(create_parser(["info"]).parse_args(["info", *words]))


def test_json_holds_the_values_that_programs_need(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record_plan(tmp_path / "s")
    assert run(str(tmp_path / "s"), "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["trials_planned"] == answer["trials_committed"] == 8
    assert (answer["gaps"], answer["lost_samples"]) == (0, 0)
    assert answer["samples"] > sum(trial.n_samples for trial in plan().trials)
    assert answer["rig"] == "virtual"
    assert answer["firmware"] == {"taxels": "1.0 (0badcafe)"}
    assert answer["layout"] == "rigctl-session 1"
    assert answer["written_by"] is None
    assert "world" not in answer
    assert run(str(tmp_path / "s")) == 0
    assert "trials committed   8" in capsys.readouterr().out


def test_a_session_being_written_names_its_writer(tmp_path: Path) -> None:
    with Recorder(tmp_path / "s", header(), PROTOCOL, RIG) as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        answer = summarise_session(tmp_path / "s")
        assert answer["written_by"] is not None
        assert answer["finished"] is False


def test_a_folder_of_sessions_is_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record_plan(tmp_path / "project" / "whole")
    with Recorder(tmp_path / "growing", header(), PROTOCOL, RIG) as rec:
        rec.begin_part("start", "A")
        rec.wait_written()
        assert run(str(tmp_path), "--json") == 0
        states = {Path(row["path"]).name: row["state"] for row in json.loads(capture_out(capsys))}
    assert states == {"whole": "complete", "growing": "recording"}
    assert run(str(tmp_path)) == 0
    lines = capture_out(capsys)
    assert "project/whole: 8 of 8 trials, complete" in lines
    assert "growing: 0 of 8 trials, incomplete" in lines


def capture_out(capsys: pytest.CaptureFixture[str]) -> str:
    """Return what was printed since the last call."""
    return capsys.readouterr().out


def test_the_table_of_attempts_has_their_notes(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    add_note(tmp_path / "s", SessionNote("2026-11-24T09:00:00Z", "new plates"))
    add_note(tmp_path / "s", SessionNote("2026-11-24T09:01:00Z", "a, b", 2, 0, Mark.BAD))
    assert run(str(tmp_path / "s"), "--csv", str(tmp_path / "trials.csv")) == 0
    comment, *table = (tmp_path / "trials.csv").read_text("utf-8").splitlines()
    assert comment == "# 2026-11-24T09:00:00Z new plates"
    rows = {row["trial_id"]: row for row in csv.DictReader(table)}
    assert len(rows) == 8 and rows["1"]["counts"] == "yes"
    assert (rows["2"]["counts"], rows["2"]["why_not"]) == ("no", "marked bad: a, b")
    assert rows["2"]["notes"] == "marked bad: a, b"


def test_a_folder_without_a_session_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="is not a session"):
        run(str(tmp_path))


def truth_of(session: Session) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """Write a log that is 1 ‰ fast and 1 % heavy in every window and arbitrary elsewhere."""
    end = session.parts[-1].read("/taxels/counter", session.parts[-1].n_samples - 1, 10**9)[0]
    speed = np.full(int(end) + 1, 7.0, np.float32)
    force = np.zeros_like(speed)
    sync = np.zeros(len(speed), np.uint8)
    for row in session.trials:
        window = slice(int(row["first_counter"]), int(row["first_counter"] + row["count"]))
        speed[window] = row["speed_mm_s"] * 1.001
        force[window] = row["force_g"] * 0.99
        sync[window.start - 1 : window.stop + 5] = 1
    return 0, speed, force, sync


def test_each_trial_has_its_true_speed_and_force(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    with Session.open(tmp_path / "s") as session:
        log = truth_of(session)
        half, (_, speed, force, sync) = len(log[1]) // 2, log
        writer = begin_log(tmp_path / "s", START, 0)
        writer.write((0, speed[:half], force[:half], sync[:half]))
        writer.write((half, speed[half:], force[half:], sync[half:]))
        assert writer.close().name == "world.h5"
        with open_truth(tmp_path / "s" / "world.h5") as truth:
            assert np.array_equal(truth.window("speed_mm_s", 0, truth.n_rows), log[1])
        truths = trial_truths(session)
    assert [truth.trial_id for truth in truths] == list(range(1, 9))
    for truth in truths:
        assert truth.speed_error == pytest.approx(0.001, abs=1e-5)
        assert truth.force_error == pytest.approx(-0.01, abs=1e-5)
    world = summarise_session(tmp_path / "s")["world"]
    assert world["trials"] == 8
    assert world["max_speed_error_permille"] == pytest.approx(1, abs=0.01)
    assert world["max_force_error_permille"] == pytest.approx(10, abs=0.01)
    assert any("its log holds 8 trials" in note for note in verify(tmp_path / "s").notes)


def test_a_gap_in_the_log_is_refused(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    empty = (np.zeros(3, np.float32), np.zeros(3, np.float32), np.zeros(3, np.uint8))
    writer = begin_log(tmp_path / "s", START, 0)
    writer.write((0, *empty))
    with pytest.raises(SessionError, match="ends at 3 ms and the new rows begin at 5 ms"):
        writer.write((5, *empty))
    writer.close()


def test_each_run_of_a_session_has_its_own_log(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    later = {name: getattr(header(), name) for name in type(header()).__slots__}
    later["start_utc"] = "2026-11-22T08:00:00Z"
    with Recorder(tmp_path / "s", type(header())(**later), PROTOCOL, RIG, resume=True) as rec:
        rec.begin_part("resume", "A")
    columns = (np.ones(IDLE, np.float32), np.ones(IDLE, np.float32), np.zeros(IDLE, np.uint8))
    writer = begin_log(tmp_path / "s", ("2026-11-22T08:00:00Z", 0.0), 0)
    writer.write((0, *columns))
    assert writer.close().name == "world-0002.h5"
    with Session.open(tmp_path / "s") as session:
        assert trial_truths(session) == []


def test_a_damaged_log_is_a_problem(tmp_path: Path) -> None:
    record_plan(tmp_path / "s")
    (tmp_path / "s" / "world.h5").write_bytes(b"not HDF5")
    assert any("world.h5 is damaged" in line for line in verify(tmp_path / "s").problems)
