"""A session of the moving finger that grows shows a follower what its engine shows."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.acquisition.rpc.messages import encode_message
from rigctl.realtime.follow.followed_finger import FollowedFinger
from rigctl.realtime.follow.growing_finger_session import GrowingFingerSession
from rigctl.realtime.live_file import FingerLiveReader, FingerLiveWriter
from rigctl.realtime.messages import FingerEngineStatus, parse_finger_status
from rigctl.session.finger_session import FingerSession
from rigctl.values import Event
from tests.realtime.conftest import Trained
from tests.realtime.harness import SMALL, FingerHarness, open_finger_harness


class Followed:
    """A follower of a session, and what it told."""

    def __init__(self, folder: Path) -> None:
        self.writer = FingerLiveWriter(folder / "followed.live")
        self.reader = FingerLiveReader(self.writer.path)
        self.finger = FollowedFinger(GrowingFingerSession(folder / "session"), self.writer)
        self.events: list[Event] = []
        self.statuses: list[FingerEngineStatus] = []

    def look(self) -> None:
        self.finger.refresh()
        for events in self.finger.take(0.0):
            self.events += events
        status = self.finger.status(0.0)
        data = json.loads(encode_message({"data": status}))["data"]
        self.statuses.append(parse_finger_status(data))

    def of_kind(self, kind: str) -> list[Event]:
        return [event for event in self.events if event.kind == kind]

    def close(self) -> None:
        self.finger.close()
        self.reader.close()
        self.writer.close()


def values(events: list[Event], kind: str, name: str) -> list[Any]:
    return [event.data[name] for event in events if event.kind == kind]


def batches(events: list[Event]) -> dict[tuple[int, float], list[float]]:
    """Return velocity and way of each batch; the engine tells the last one of a scan twice."""
    data = [event.data for event in events if event.kind == "batch"]
    return {
        (each["scan"], round(each["scaled_s"], 3)): [each["velocity_mm_s"], each["distance_mm"]]
        for each in data
    }


def followed_run(harness: FingerHarness, trained: Trained) -> tuple[Followed, list[Event]]:
    """Record a run that is followed from its first scan on; return what the engine told, too."""
    found: list[Followed] = []

    async def scenario(harness: FingerHarness) -> None:
        await harness.until_scanning()
        found.append(Followed(harness.folder))
        while not harness.has_ended():
            found[0].look()
            for _ in range(30):
                await asyncio.sleep(0.01)
        found[0].look()

    harness.run(scenario, harness.request("run", protocol=SMALL, model=trained.model))
    return found[0], harness.events


def test_a_run_is_followed_to_its_end(tmp_path: Path, trained: Trained) -> None:
    with open_finger_harness(tmp_path, session=1) as harness:
        followed, told = followed_run(harness, trained)
        last = followed.statuses[-1].run
        with FingerSession.open(harness.session) as session:
            n_samples = session.n_samples
            named = int(np.sum(session.trials["predicted"] != ""))
        engine = harness.engine.status()
    of_engine, of_follower = batches(told), batches(followed.events)
    assert of_follower.keys() == of_engine.keys() and len({scan for scan, _ in of_engine}) == 6
    for batch, numbers in of_follower.items():
        assert numbers == pytest.approx(of_engine[batch])
    for name in ("scan", "texture", "windows", "decided", "is_final"):
        assert values(followed.events, "prediction", name) == values(told, "prediction", name)
    assert all("sent_s" not in event.data for event in followed.of_kind("prediction"))
    assert len(followed.of_kind("trial")) >= 2 and followed.of_kind("instruction")
    assert (last.state, last.trials_committed) == ("done", engine.run.trials_committed)
    assert (last.classified, last.correct) == (engine.run.classified, engine.run.correct)
    assert last.classified == named and last.confusion == engine.run.confusion
    assert last.textures == engine.run.textures and last.quality == engine.run.quality
    running = [status.run for status in followed.statuses if status.run.state == "running"]
    assert any(run.scan is not None and run.scan.scanning for run in running)
    assert any(run.scan is not None and run.scan.stage == "run" for run in running)
    assert followed.statuses[-1].recording.samples_on_disk == n_samples
    assert not followed.statuses[-1].finger_connected
    samples, track = followed.reader.taxels(5000), followed.reader.track(1000)
    assert samples.spikes.sum() > 0 and np.all(np.diff(samples.counters) == 1)
    assert np.all(np.diff(track.time_s) > 0) and track.valid.any()
    assert np.nanmax(track.along_mm) > 200
    assert (followed.reader.normalisation[0] > 0).any()
    followed.close()


def test_a_pause_and_a_question_are_seen(tmp_path: Path) -> None:
    async def scenario(harness: FingerHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.control.prompt is not None)
        run.control.answer(1, "ok")
        await harness.until_scanning()
        followed = Followed(harness.folder)
        run.control.pause()
        await harness.until(lambda: len(harness.texts("trial")) > 0)
        await _flushed(harness, followed, lambda s: s.run.state == "paused")
        assert followed.statuses[-1].run.reasons == ("operator",)
        run.control.resume()
        await harness.until(lambda: run.control.prompt is not None, 600.0)
        await _flushed(harness, followed, lambda s: s.run.prompt is not None)
        prompt = followed.statuses[-1].run.prompt
        assert prompt is not None and prompt.texture == "L" and "Lay plate L" in prompt.text
        run.control.answer(2, "ok")
        await harness.until_scanning()
        await _flushed(harness, followed, lambda s: s.run.state == "running")
        run.control.abort("the test is over")
        await harness.until(harness.has_ended)
        followed.look()
        assert followed.statuses[-1].run.state == "aborted"
        followed.close()

    with open_finger_harness(tmp_path) as harness:
        two = SMALL.replace('"A", "D", "L"', '"D", "L"').replace('"medium", "fast"', '"medium"')
        harness.run(scenario, harness.request("normalise", protocol=two, yes=False))


async def _flushed(harness: FingerHarness, followed: Followed, is_true: object) -> None:
    """Wait until the recorder has flushed what makes a status true."""
    assert callable(is_true)

    def seen() -> bool:
        followed.look()
        return bool(is_true(followed.statuses[-1]))

    await harness.until(seen, 10_000)
