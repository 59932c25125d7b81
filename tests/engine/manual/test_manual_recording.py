"""Operation by hand is recorded into a session that every reader opens and verifies."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.engine.health import DiskMonitor
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.session.verify import verify
from tests.engine.engine_harness import EngineHarness, open_session


async def press_and_turn(harness: EngineHarness) -> None:
    """Do what a person would do by hand."""
    for command in ("arm", "tare", "approach", "run", "retract"):
        await harness.handle(command, {})


def test_a_recording_by_hand_is_a_whole_session(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        args = {"out": str(harness.session), "note": "a new skin, pressed lightly"}
        assert await harness.handle("record", args) == {"session": str(harness.session)}
        await press_and_turn(harness)
        recording = harness.engine.status().recording
        assert recording.by_hand and recording.folder == str(harness.session)
        await harness.handle("plate", {"texture": "K"})
        await harness.wait(1)
        assert await harness.handle("end_record", {}) == {"session": str(harness.session)}
        assert not harness.engine.status().recording.by_hand

    harness.run(scenario)
    report = verify(harness.session)
    assert report.problems == []
    with open_session(harness.session) as session:
        texts = [event.text for event in session.events]
        assert len(session.parts) == 2 and len(session.trials) == 0
        assert "a new skin, pressed lightly" in texts and "in contact, turning" in texts


async def test_a_recording_by_hand_and_a_run_exclude_each_other(harness: EngineHarness) -> None:
    with pytest.raises(WrongUse, match="nothing is recorded by hand"):
        await harness.handle("end_record", {})
    await harness.handle("record", {"out": str(harness.folder / "first")})
    with pytest.raises(WrongUse, match="first is being recorded: end that first"):
        await harness.handle("record", {"out": str(harness.session)})
    with pytest.raises(WrongUse, match="end it first, then start the run"):
        harness.engine.start(harness.request())
    await harness.handle("end_record", {})
    with pytest.raises(SessionError):
        await harness.handle("record", {"out": str(harness.folder / "first")})
    run = harness.engine.start(harness.request())
    with pytest.raises(WrongUse, match="a run is active"):
        await harness.handle("record", {"out": str(harness.folder / "second")})
    run.control.abort("enough")
    await harness.until(harness.has_ended)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ({"out": "somewhere"}, "no whole path: choose the folder"),
        ({"out": "/proc/nowhere"}, "choose another disk"),
        ({"out": "/tmp/x\n"}, "out: "),
        ({"out": "/tmp/x", "note": "n" * 501}, "note: "),
        ({"out": "/tmp/x", "note": "two\nlines"}, "note: "),
        ({"note": "no folder"}, "required"),
    ],
)
async def test_a_wrong_request_is_refused_in_a_sentence(
    harness: EngineHarness, args: dict[str, str], words: str
) -> None:
    with pytest.raises((WrongUse, DiskFault), match=words):
        await harness.handle("record", args)
    assert not harness.engine.manual.is_recording


def test_a_full_disk_ends_the_recording_and_keeps_it(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.handle("record", {"out": str(harness.session)})
        await harness.wait(2)
        monkeypatch.setattr(DiskMonitor, "must_pause", lambda self, paused: True)
        await harness.until(lambda: not harness.engine.manual.is_recording)
        assert "the disk is full" in harness.texts("disk")[0]

    harness.run(scenario)
    assert verify(harness.session).problems == []


def test_the_end_of_the_engine_closes_the_recording(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.handle("record", {"out": str(harness.session)})
        await harness.wait(1)

    harness.run(scenario)
    assert verify(Path(harness.session)).problems == []
