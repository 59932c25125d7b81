"""A follower outlives a folder that vanishes, and files with strange numbers."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from rigctl.acquisition.follow.follow_engine import FollowCommands, FollowEngine
from rigctl.acquisition.follow.followed_drum import FollowedDrum
from rigctl.acquisition.follow.followed_run import FollowedRun
from rigctl.acquisition.follow.followed_status import FollowedStatus
from rigctl.acquisition.follow.growing_reader import finite
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rpc.door import Door, open_listener
from rigctl.session.session import Session
from rigctl.values import Event
from tests.acquisition.engine_harness import EngineHarness
from tests.acquisition.sharing.client_connection import ClientConnection
from tests.session import building


@contextmanager
def follow_engine(session: Path, folder: Path) -> Iterator[FollowEngine]:
    loop = asyncio.SelectorEventLoop()
    writer = LiveWriter(folder / "followed.live")
    yield FollowEngine(loop, FollowedDrum(GrowingSession(session), writer), writer)
    writer.close()
    loop.close()


def copy_unended(harness: EngineHarness, folder: Path) -> None:
    """Record two plates, and copy the session as it was while its second part grew."""

    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: harness.engine.status().run.trials_committed > 2)
        assert harness.engine.run is not None
        harness.engine.run._recorder.wait_written()  # its thread may be behind the count
        shutil.copytree(harness.session, folder)
        await harness.until(harness.has_ended)

    harness.run(scenario, harness.request())


def _event_times_s(folder: Path) -> list[float]:
    with Session.open(folder) as session:
        return [event.at_s for event in session.events]


def test_a_folder_that_vanishes_and_returns(harness: EngineHarness, tmp_path: Path) -> None:
    session, away = tmp_path / "copy", tmp_path / "away"
    copy_unended(harness, session)

    async def watch(engine: FollowEngine, client: ClientConnection) -> None:
        while not (await client.until("status"))["data"]["recording"]["samples_on_disk"]:
            pass
        session.rename(away)
        lost = await client.until("lost")
        assert "the session cannot be read now" in lost["text"]
        for _ in range(5):
            status = (await client.until("status"))["data"]
            assert status["run"]["trials_committed"] == 3
        away.rename(session)
        shutil.copytree(harness.session, session, dirs_exist_ok=True)
        trial = await client.until("trial")
        assert trial["at_s"] in _event_times_s(session), "of the recorder, as those of the rows"
        while (status := (await client.until("status"))["data"])["run"]["state"] != "done":
            pass
        assert status["run"]["trials_committed"] == 4
        await client.close()
        engine.shut_down("the test is over")

    with follow_engine(session, tmp_path) as engine, open_listener() as listener:

        async def both() -> int:
            door = Door(listener, "token")
            serving = asyncio.ensure_future(engine.serve(door, FollowCommands(engine).handle, None))
            client = await ClientConnection.connect(listener.getsockname(), "watcher")
            await watch(engine, client)
            return await serving

        assert engine.loop.run_until_complete(asyncio.wait_for(both(), 60)) == 0


def test_a_pause_is_seen_and_its_end(harness: EngineHarness, tmp_path: Path) -> None:
    """A pause ends the part, so its end stands in no event: a new part says it."""
    states: list[str] = []

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: harness.engine.status().run.trials_committed > 0)
        writer = LiveWriter(tmp_path / "followed.live")
        followed = FollowedDrum(GrowingSession(harness.session), writer)

        def state() -> str:
            followed.refresh()
            for _ in followed.take(0.0):
                pass
            return followed.status(0.0).run.state

        run.control.pause()
        await harness.until(lambda: state() == "paused")
        run.control.resume()
        await harness.until(lambda: state() == "running")
        await harness.until(harness.has_ended)
        states.append(state())
        followed.close()
        writer.close()

    harness.run(scenario, harness.request())
    assert states == ["done"]


def test_the_moment_between_two_parts_is_no_end(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    with building.recorder(folder) as recorder:
        recorder.begin_part("start", "A")
        recorder.wait_written()
        with closing(GrowingSession(folder)) as growing:
            status = FollowedStatus(growing.session)

            def state() -> str:
                growing.refresh()
                for rows in growing.take_rows():
                    status.update(rows, 0.0)
                return status.build(0.0).run.state

            assert state() == "running"
            recorder._put(recorder._writer.close_part)
            recorder.wait_written()
            assert state() == "running", "the recorder is about to begin the next part"
            recorder.begin_part("another plate", "L")
            recorder.close()
            assert state() == "aborted"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_no_message_can_hold_is_zero(value: float) -> None:
    assert finite(value) == 0.0
    assert finite(1.5) == 1.5


def test_the_events_tell_what_a_run_waits_for() -> None:
    run = FollowedRun()
    run.begin_part()
    run.update([Event(1.0, "pause", "", {"reason": "operator"}), Event(1.1, "pause", "", {})])
    assert run.state(has_ended=False) == "paused" and run.reasons == ("operator", "None")
    run.update([Event(2.0, "resume", "", {"reason": "operator"})])
    run.begin_part()
    assert run.state(has_ended=False) == "running"
    run.update([Event(3.0, "prompt", "mount B", {"id": True, "texture": 7})])
    assert run.prompt is not None and (run.prompt.id, run.prompt.texture) == (0, None)
    run.update([Event(4.0, "log", "something else")])
    assert run.state(has_ended=False) == "prompt" and run.reasons == ("prompt",)
    run.update([Event(5.0, "trial", "")])
    assert run.state(has_ended=False) == "running"
    run.update([Event(6.0, "session_end", "", {"outcome": "failed"})])
    assert run.state(has_ended=True) == "failed"
