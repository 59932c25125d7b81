"""`rigctl watch`: a session is watched while it grows, before its first part, and to its end."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import msgspec
import numpy as np
import pytest

from rigctl.cli import main, session_looks, watch
from rigctl.cli.session_looks import LETTERS, NOTHING_YET, Look, due_words, looks, spike_raster
from rigctl.engine.rpc.client import FoundEngine
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, EngineFile
from rigctl.engine.runner import Run
from rigctl.errors import SessionError
from rigctl.finger.session import FingerSession
from rigctl.session.session import Session
from rigctl.session.session_reader import QUARANTINE_KIND
from rigctl.values import Event, Spikes, Verdict
from tests.engine.engine_harness import TINY, EngineHarness, open_harness
from tests.finger.harness import SMALL, FingerHarness, open_finger_harness
from tests.session.building import SyntheticRig, plan, recorder


@pytest.fixture(autouse=True)
def no_other_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))


def watched(folder: Path) -> Iterator[Look]:
    """Return the looks at a session, of which the first is made now."""
    return iter(looks(folder))


def test_events_trials_and_the_end_are_seen_as_they_are_recorded(tmp_path: Path) -> None:
    found: list[Look] = []

    async def scenario(harness: EngineHarness) -> None:
        prompt = harness.engine.run
        assert prompt is not None
        await harness.until(lambda: prompt.control.prompt is not None)
        view = watched(harness.session)
        found.append(next(view))
        assert found[0].line == NOTHING_YET and not found[0].is_gone
        prompt.control.answer(1, "ok")
        while not harness.has_ended():
            await harness.wait(1.0)
            if prompt.control.prompt is not None:
                prompt.control.answer(prompt.control.prompt.id, "ok")
            found.append(next(view))
        found.append(next(view))

    with open_harness(tmp_path) as harness:
        harness.run(scenario, harness.request(TINY, yes=False))
        with Session.open(harness.session) as session:
            assert len(session.parts) == 2
            texts = [event.text for event in session.events if event.text]
    lines = [look.line for look in found]
    assert lines[-1].startswith("4 of 4 trials, 0 rejected;") and " 0 lost; " in lines[-1]
    counts = [int(line.split(" of 4 trials")[0]) for line in lines if " of 4 trials" in line]
    assert counts == sorted(counts) and counts[0] < 4  # how far depends on when the disk has it
    seen = [text for look in found for text in look.news]
    assert seen == texts
    assert found[-1].has_ended and not any(look.has_ended for look in found[:-2])


def test_what_the_run_does_and_when_the_plate_changes_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    news: list[list[str]] = []
    due: list[list[str]] = []

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        monkeypatch.setattr(session_looks, "find_engines", lambda: [engine_of(run)])
        view = watched(harness.session)

        def look() -> None:
            news.append(next(view).news)
            due.append(due_words(session_looks.run_of(harness.session)))

        await harness.until(lambda: run.control.prompt is not None)
        look()
        run.control.answer(1, "ok")
        await harness.until(lambda: run.status().trial_id == 1)
        look()
        await harness.until(lambda: run.status().trials_committed == 1)
        look()
        run.control.pause()
        await harness.until(lambda: run.status().state == "paused")
        look()
        await harness.wait(60)
        look()
        run.control.abort("enough")
        await harness.until(harness.has_ended)

    with open_harness(tmp_path) as harness:
        harness.run(scenario, harness.request(TINY, yes=False))
    assert news[0] == ["waits for an answer: Mount plate A, then confirm."]
    assert news[1][-1].startswith("trial 1: A, ") and news[2][-1].startswith("trial 2: A, ")
    assert news[3][-1] == "paused: operator" and "paused: operator" not in news[4]
    first, second = (text for text, _ in due[1:3])
    assert first.startswith("plate L in 0:00:") and first.endswith(", after this trial and 1 more")
    assert second.startswith("plate L in 0:00:") and second.endswith(", after this trial")
    assert second < first
    assert due[3] == due[4] and due[3][-1].startswith("end in 0:00:")


def engine_of(run: Run) -> FoundEngine:
    """Return the engine of a run as one that was found on this computer."""
    at = EngineFile("one", 1, 0, "", "virtual", "")
    return FoundEngine(at, msgspec.to_builtins(run.status()))


def test_without_a_session_the_newest_run_here_is_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["watch"]) == 2
    assert "no run is active on this computer" in capsys.readouterr().err
    with open_harness(tmp_path) as harness:
        harness.record()
    run = {"state": "running", "session": str(tmp_path / "session")}
    here = FoundEngine(EngineFile("one", 1, 0, "", "virtual", ""), run)
    monkeypatch.setattr(watch, "find_engines", lambda: [here])
    assert main(["watch"]) == 0
    assert "4 of 4 trials" in capsys.readouterr().out


def test_what_was_repeated_or_put_into_quarantine_before_is_told_with_its_reason(
    tmp_path: Path,
) -> None:
    with recorder(tmp_path / "session") as rec:
        source, (first, second, *_) = SyntheticRig(rec), plan().trials
        rec.begin_part("start", first.texture)
        source.trial(first, Verdict.REJECTED)
        source.trial(first, attempt=2)
        source.trial(second)
        about = {"trial_id": second.trial_id, "attempt": 1}
        rec.add_event(Event(1.0, QUARANTINE_KIND, "trial 2 is in quarantine: taxel 7", about))
        for number in range(session_looks.PAST_EVENTS):
            rec.add_event(Event(2.0, "log", f"line {number}"))
    look = next(watched(tmp_path / "session"))
    with Session.open(tmp_path / "session") as session:
        reasons = session.trial_row(0).reasons
    assert look.news[:2] == [
        f"trial 1 rejected: {'; '.join(reasons)}",
        "trial 2 is in quarantine: taxel 7",
    ]
    assert "1 rejected, 1 in quarantine; " in look.line


def test_the_newest_trial_is_drawn_as_text_once(tmp_path: Path) -> None:
    with open_harness(tmp_path) as harness:
        harness.record()
    view = iter(looks(tmp_path / "session", 60))
    *_, title = (text for text in next(view).news if text.startswith("trial 4 ("))
    assert title.endswith("ms:")
    assert next(view).news == []
    with Session.open(tmp_path / "session") as session:
        _, *lines = session_looks.trial_raster(session, 3).lines(60, LETTERS)
    assert [line[:3] for line in lines] == ["SA "] * 9 + ["RA "] * 9
    assert {len(line) for line in lines} == {60} and any("@" in line for line in lines)


def test_marks_stand_where_the_spikes_are() -> None:
    first, second = np.array([0, 1, 2, 3, 50], np.int32), np.array([99], np.int32)
    spikes = Spikes.from_trains([first, second], 100)
    lines = spike_raster("a trial", spikes).lines(13, LETTERS)
    assert lines == ["a trial", "SA @    :    ", "RA          @"]


def test_a_session_of_the_finger_is_watched(tmp_path: Path) -> None:
    found: list[Look] = []

    async def scenario(harness: FingerHarness) -> None:
        await harness.until_scanning()
        found.extend(next(watched(harness.session)) for _ in range(2))
        await harness.until(harness.has_ended)

    with open_finger_harness(tmp_path) as harness:
        harness.run(scenario, harness.request("normalise", protocol=SMALL))
        found.append(next(watched(harness.session)))
        with FingerSession.open(harness.session) as session:
            planned = session.header.trials_planned
        view = iter(looks(harness.session, 60, LETTERS))
        title, *lines = next(view).news[-10:]
        assert next(view).news == []
    assert f"of {planned} trials" in found[0].line and not found[0].has_ended
    assert found[-1].has_ended
    assert title.startswith(f"scan {planned} (") and title.endswith(" ms:")
    assert {len(line) for line in lines} == {60} and any("@" in line for line in lines)


def test_the_command_ends_with_the_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_harness(tmp_path) as harness:
        harness.record()
    assert main(["watch", str(tmp_path / "session")]) == 0
    out = capsys.readouterr().out
    assert "The part was closed in order.\n4 of 4 trials" in out


def test_a_recorder_that_is_gone_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run that was killed while it asked for its first plate was awaited for ever."""
    killed = subprocess.Popen(["true"])
    killed.wait()
    (tmp_path / "protocol.toml").write_text(TINY)
    (tmp_path / "writer.lock").write_text(f"{killed.pid}\n{socket.gethostname()}\n")
    assert main(["watch", str(tmp_path)]) == 1
    assert "is gone: continue it with --resume" in capsys.readouterr().err


def test_a_folder_that_vanishes_is_waited_for(tmp_path: Path) -> None:
    with open_harness(tmp_path) as harness:
        harness.record()
    view = watched(tmp_path / "session")
    assert next(view).has_ended
    (tmp_path / "session").rename(tmp_path / "away")
    assert "cannot be read now" in next(view).line
    (tmp_path / "away").rename(tmp_path / "session")
    next(view)
    assert next(view).has_ended


def test_what_cannot_be_read_is_opened_anew_before_the_next_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """HDF5 may fail on an open file whose writer closes it, and then fails each time."""
    with open_harness(tmp_path) as harness:
        harness.record()
    view = watched(tmp_path / "session")
    assert next(view).has_ended
    failed: list[Session] = []
    committed, refresh = Session.committed, Session.refresh

    def fail(session: Session) -> NoReturn:
        failed.append(session)
        raise SessionError("HDF5 cannot read /events")

    def open_anew(session: Session) -> None:
        if failed:
            monkeypatch.setattr(Session, "committed", committed)
        refresh(session)

    monkeypatch.setattr(Session, "committed", fail)
    monkeypatch.setattr(Session, "refresh", open_anew)
    assert "cannot be read now" in next(view).line
    assert next(view).has_ended


def test_another_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="is not a session"):
        next(watched(tmp_path))
