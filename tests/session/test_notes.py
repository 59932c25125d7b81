"""Notes and verdicts that are added later are dated files beside the parts."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.errors import SessionError
from rigctl.session.notes import Mark, SessionNote, read_notes
from rigctl.session.session import Session, add_note
from rigctl.session.summary import read_line, summarise_session
from rigctl.session.trial_csv import write_trials
from rigctl.session.verify import verify
from tests.session.building import SyntheticRig, plan, record_repeats, recorder

NOON = "2026-11-23T12:00:00Z"


def note_files(session: Path) -> list[str]:
    return sorted(path.name for path in session.glob("note-*.json"))


def committed_ids(session: Path) -> list[int]:
    with Session.open(session) as opened:
        return [int(opened.trials["trial_id"][i]) for i in opened.committed()]


def test_a_note_is_a_dated_file_and_the_record_is_unchanged(session: Path) -> None:
    before = {path.name: path.read_bytes() for path in session.iterdir()}
    closing = verify(session).closing_digest
    add_note(session, SessionNote(NOON, "the plate was dusty, 30 µm", author="Jörg"))
    add_note(session, SessionNote(NOON, "cleaned it"))
    assert note_files(session) == ["note-20261123T120000Z-002.json", "note-20261123T120000Z.json"]
    assert [note.text for note in read_notes(session)] == [
        "the plate was dusty, 30 µm",
        "cleaned it",
    ]
    assert read_notes(session)[0].author == "Jörg"
    assert {name: (session / name).read_bytes() for name in before} == before
    report = verify(session)
    assert report.whole and report.closing_digest == closing
    assert any("the plate was dusty" in line for line in report.notes)


def test_a_trial_marked_bad_does_not_count_and_the_mark_can_be_taken_back(session: Path) -> None:
    before = committed_ids(session)
    add_note(session, SessionNote(NOON, "slipped", trial_id=2, attempt=1, mark=Mark.BAD))
    assert committed_ids(session) == [number for number in before if number != 2]
    with Session.open(session) as opened:
        (line,) = opened.describe_missing()
    assert "trial 2 is left out: marked bad: slipped" in line
    report = verify(session)
    assert report.whole and report.trials_committed == len(before) - 1
    later = SessionNote("2026-11-23T12:00:01Z", "it had not", 2, 1, Mark.GOOD)
    add_note(session, later)
    assert committed_ids(session) == before


def test_a_trial_that_was_repeated_is_not_left_out(tmp_path: Path) -> None:
    """Nothing is missing: the session was listed as incomplete, its reports told of trials out."""
    session = tmp_path / "repeats"
    record_repeats(session)
    with Session.open(session) as opened:
        assert opened.describe_missing() == [] and opened.repeated == {0, 2}
        (line,) = opened.describe_repeated()
    assert line == "part-0001.h5: trial 2 was repeated: marked bad: slipped"
    assert (read_line(session).state, read_line(session).reason) == ("complete", "")
    remarks = "\n".join(join_sessions([session]).remarks)
    assert "attempts repeated: 1 rejected" in remarks and "left out" not in remarks
    out = tmp_path / "trials.csv"
    write_trials(session, out)
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [row["why_not"] for row in rows[:4]] == [
        *("repeated", "", "marked bad: slipped; repeated", ""),
    ]
    bad = SessionNote(NOON, "slipped, too", 2, 2, Mark.BAD)
    add_note(session, bad)
    with Session.open(session) as opened:
        first, second = opened.describe_missing()
        assert opened.describe_repeated() == []
    assert "trial 2 is left out: marked bad: slipped" in first and "slipped, too" in second


def test_a_damaged_note_is_named_and_marks_nothing(session: Path) -> None:
    before = committed_ids(session)
    path = add_note(session, SessionNote(NOON, "slipped", 2, 1, Mark.BAD))
    assert json.loads(path.read_text())["closing_digest"] == verify(session).closing_digest
    path.write_text(path.read_text()[:-20])
    assert read_notes(session) == () and committed_ids(session) == before
    report = verify(session)
    assert not report.whole and any(path.name in line for line in report.problems)
    assert any(path.name in line for line in summarise_session(session)["missing"])


@pytest.mark.parametrize(
    "note",
    [
        SessionNote(NOON, ""),
        SessionNote(NOON, "x" * 2001),
        SessionNote(NOON, "bell \a"),
        SessionNote(NOON, "no such trial", trial_id=99, attempt=1, mark=Mark.BAD),
        SessionNote(NOON, "no such attempt", trial_id=2, attempt=7, mark=Mark.BAD),
        SessionNote("yesterday", "when?"),
        SessionNote(NOON, "a moment of no trial", at_s=1.0),
        SessionNote(NOON, "before the trial", 2, 1, at_s=-1.0),
        SessionNote(NOON, "no moment", 2, 1, at_s=float("nan")),
    ],
)
def test_what_is_no_note_is_refused_in_a_sentence(session: Path, note: SessionNote) -> None:
    with pytest.raises(SessionError):
        add_note(session, note)
    assert note_files(session) == []


def test_notes_are_for_sessions(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="is not a session"):
        add_note(tmp_path, SessionNote(NOON, "lost"))


def test_a_note_does_not_follow_a_link_outside(session: Path, tmp_path: Path) -> None:
    outside = tmp_path / "elsewhere.json"
    outside.write_text("{}")
    (session / "note-20261123T120000Z.json").symlink_to(outside)
    assert read_notes(session) == ()
    assert not verify(session).whole


def test_the_command_writes_and_lists_notes(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["note", str(session), "the room was cold"]) == 0
    assert main(["note", str(session), "slipped", "--trial", "2", "--bad"]) == 0
    assert 2 not in committed_ids(session)
    assert main(["note", str(session), "it had not", "--trial", "2", "--good"]) == 0
    assert 2 in committed_ids(session)
    capsys.readouterr()
    assert main(["note", str(session)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert lines[1].endswith("trial 2, attempt 1, marked bad: slipped")
    assert len(summarise_session(session)["notes"]) == 3
    assert main(["note", str(session), "which?", "--bad"]) == 2


def test_a_trial_says_its_mounting(tmp_path: Path) -> None:
    folder, trial = tmp_path / "session", replace(plan().trials[0], mount=2)
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        SyntheticRig(rec).trial(trial)
    with Session.open(folder) as session:
        assert session.trial_row(0).trial == trial
    assert summarise_session(folder)["mounts"] == 2
    assert [one.mount for one in join_sessions([folder]).trials] == [2]


def test_a_note_on_a_moment_is_a_mark_in_its_trial(session: Path) -> None:
    assert main(["note", str(session), "a squeak", "--trial", "2", "--at", "0.25"]) == 0
    assert main(["note", str(session), "dusty", "--trial", "2"]) == 0
    (moment,) = [note for note in read_notes(session) if note.at_s is not None]
    assert (moment.trial_id, moment.at_s) == (2, 0.25)
    assert moment.describe() == "trial 2, attempt 1, at 0.25 s: a squeak"
    with Session.open(session) as opened:
        row = opened.trials["trial_id"].tolist().index(2)
        assert opened.trial_marks(row) == ((0.0, "dusty"), (0.25, "a squeak"))
        assert set(opened.trial_notes()[row].split("; ")) == {"at 0.25 s: a squeak", "dusty"}
        assert opened.trial_marks(row + 1) == ()
