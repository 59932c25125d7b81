"""`rigctl watch`: a session is watched while it grows, before its first part, and to its end."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from rigctl.cli import main
from rigctl.cli.watch import NOTHING_YET, Look, looks
from rigctl.errors import SessionError
from rigctl.finger.session import FingerSession
from rigctl.session.session import Session
from tests.engine.engine_harness import TINY, EngineHarness, open_harness
from tests.finger.harness import SMALL, FingerHarness, open_finger_harness


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
    seen = [text for look in found for text in look.events]
    assert seen == texts
    assert found[-1].has_ended and not any(look.has_ended for look in found[:-2])


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
    assert f"of {planned} trials" in found[0].line and not found[0].has_ended
    assert found[-1].has_ended


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
