"""What meets a study of weeks: a slow disk, a new version of program or firmware."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.boards.drum_states import State
from rigctl.engine import run_request
from rigctl.engine.run_request import RunRequest
from rigctl.session.recorder import SessionRecorder
from rigctl.session.verify import verify
from rigctl.session.writer import RecorderStatus
from tests.engine.engine_harness import EngineHarness, open_harness, open_session, until_ended
from tests.engine.protocol.test_interruptions import PAIR, drum_state, until_turning


def test_a_slow_disk_pauses_the_run_until_all_is_written(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    status = SessionRecorder.status.fget
    assert status is not None

    def behind(recorder: SessionRecorder) -> RecorderStatus:
        found: RecorderStatus = status(recorder)
        return replace(found, queue_samples=found.queue_samples + 50_000)

    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        run = harness.engine.run
        assert run is not None
        with monkeypatch.context() as patch:
            patch.setattr(SessionRecorder, "status", property(behind))
            await harness.until(lambda: run.status().reasons == ("disk",))
            await harness.until(lambda: drum_state(harness) is State.IDLE)
            await harness.wait(90)
            assert run.status().state == "paused"
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert "the run pauses: the disk is too full or too slow" in harness.texts("pause")
    assert harness.engine.run is not None and harness.engine.run.complete
    assert verify(harness.session).whole


def test_a_new_version_in_the_middle_of_a_study_is_told_and_goes_on(
    harness: EngineHarness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def stopped(harness: EngineHarness) -> None:
        await harness.until(lambda: len(harness.texts("trial")) == 1)
        assert harness.engine.run is not None
        harness.engine.run.control.abort("enough")
        await until_ended(harness)

    harness.run(stopped, harness.request(PAIR))
    monkeypatch.setattr(run_request, "__version__", "9.9")
    monkeypatch.setattr(run_request, "source_commit", lambda: "cafe")
    (tmp_path / "again").mkdir()
    with open_harness(tmp_path / "again") as second:
        second.run(until_ended, RunRequest(resume=str(harness.session), yes=True))
        assert second.engine.run is not None and second.engine.run.complete
        (told,) = [text for text in second.texts("log") if text.startswith("rigctl was ")]
        assert "is 9.9 (cafe) now: the session goes on" in told
    with open_session(harness.session) as session:
        assert [part.header.software_version for part in session.parts][-1] == "9.9"
    assert verify(harness.session).whole
