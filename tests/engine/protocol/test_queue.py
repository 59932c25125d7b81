"""Runs that wait in the engine: their order, what they wait for, and what becomes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rigctl.engine import served_engine
from rigctl.engine.rpc.messages import QueueStatus
from rigctl.engine.run_queue import MAX_ENTRIES, NOT_STARTED
from rigctl.errors import ProtocolError, RigctlError, WrongUse
from tests.engine.engine_harness import TINY, EngineHarness, open_session, until_ended

ONE = TINY.replace('"A", "L"', '"A"').replace("100, 120", "120")


def queued(harness: EngineHarness, name: str, **fields: Any) -> dict[str, Any]:
    """Return the arguments that add a protocol of one trial."""
    path = harness.folder / f"{name}.toml"
    path.write_text(ONE)
    planned = {"trials": 1, "plate_changes": 1, "duration_s": 70.0}
    return {"protocol": str(path), "out": str(harness.folder), "yes": True, **planned, **fields}


def queue_of(harness: EngineHarness) -> QueueStatus:
    return harness.engine.status().queue


def names(harness: EngineHarness) -> list[str]:
    return [entry.protocol for entry in queue_of(harness).entries]


async def until_session(harness: EngineHarness, name: str) -> Path:
    """Wait until a run of this protocol has ended; return its session."""

    def is_there() -> bool:
        run = harness.engine.run
        return run is not None and run.ended and run.folder.name.startswith(f"{name}-")

    await harness.until(is_there, 600)
    assert harness.engine.run is not None
    return harness.engine.run.folder


def test_runs_follow_each_other_in_the_order_that_clients_gave_them(
    harness: EngineHarness,
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = harness.handle
        numbers = [
            (await handle("enqueue", queued(harness, name, operator=name)))["queued"]
            for name in ("third", "gone", "second")
        ]
        await handle("move_queued", {"number": numbers[2], "places": -9})
        await handle("dequeue", {"number": numbers[1]})
        assert names(harness) == ["second", "third"]
        first, last = queue_of(harness).entries
        assert queue_of(harness).waits_for == "the present run goes on"
        assert first.due_s is not None and first.due_s == harness.engine.status().run.eta_s
        assert last.due_s == first.due_s + 70.0 and (last.trials, last.plate_changes) == (1, 1)
        with pytest.raises(WrongUse, match="a run is active"):
            await handle("start_queued", {})
        await until_session(harness, "third")
        assert queue_of(harness) == QueueStatus()
        begun = [text for text in harness.texts("run") if text.startswith("the run begins")]
        assert ["second-" in begun[1], "third-" in begun[2], len(begun)] == [True, True, 3]
        (second,) = harness.folder.glob("second-*")
        with open_session(second) as recorded:
            assert recorded.header.operator == "second" and len(recorded.committed()) == 1

    harness.run(scenario, harness.request(ONE))


def test_the_queue_waits_after_a_run_that_was_stopped_and_says_so(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = harness.handle
        await handle("enqueue", queued(harness, "next"))
        await handle("pause", {})
        assert queue_of(harness).waits_for == "the present run is paused (operator)"
        await handle("stop", {})
        await until_ended(harness)
        await harness.wait(5)
        assert names(harness) == ["next"] and queue_of(harness).entries[0].due_s is None
        assert queue_of(harness).waits_for.startswith("the last run was not done (stopped by ")
        await handle("start_queued", {})
        assert names(harness) == []
        await until_session(harness, "next")

    harness.run(scenario, harness.request())


def test_a_run_that_cannot_start_stays_and_says_why(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = harness.handle
        await handle("enqueue", queued(harness, "changed"))
        (harness.folder / "changed.toml").write_text(TINY)
        await until_ended(harness)
        await harness.until(lambda: bool(harness.texts("failed")))
        why = "changed.toml has changed since it was queued: remove it and add it again"
        assert why in queue_of(harness).waits_for and why in harness.texts("failed")[-1]
        with pytest.raises(WrongUse, match="has changed since"):
            await handle("start_queued", {})
        (number,) = (entry.number for entry in queue_of(harness).entries)
        await handle("dequeue", {"number": number})
        await handle("enqueue", queued(harness, "changed"))
        assert queue_of(harness).waits_for == NOT_STARTED, "the reason went with its run"

    harness.run(scenario, harness.request(ONE))


def test_wrong_requests_change_nothing(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = harness.handle
        with pytest.raises(WrongUse, match="the queue is empty"):
            await handle("start_queued", {})
        args = queued(harness, "mine")
        wrong: list[dict[str, Any]] = [
            {**args, "resume": args["protocol"]},
            {"protocol": args["protocol"]},
            {**args, "trials": -1},
            {**args, "protocol": str(harness.folder / "nothing.toml")},
        ]
        for each in wrong:
            with pytest.raises(RigctlError):
                await handle("enqueue", each)
        with pytest.raises(ProtocolError, match="there is no protocol"):
            await handle("enqueue", wrong[-1])
        for command, values in (("dequeue", {}), ("move_queued", {"places": 1})):
            with pytest.raises(WrongUse, match="the queue has no run 7"):
                await handle(command, {"number": 7, **values})
        for _ in range(MAX_ENTRIES):
            await handle("enqueue", args)
        with pytest.raises(WrongUse, match=f"{MAX_ENTRIES} runs"):
            await handle("enqueue", args)

    harness.run(scenario)


def test_an_engine_with_a_queue_goes_on_without_a_client_and_says_what_ends_with_it(
    harness: EngineHarness,
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.handle("enqueue", queued(harness, "mine"))
        await harness.wait(2 * served_engine.IDLE_TIMEOUT_S)
        assert not harness.engine.end_if_unused("its last client has left")
        assert names(harness) == ["mine"]
        await harness.handle("shutdown", {})
        await harness.until(lambda: bool(harness.texts("lost")), 1000)

    harness.run(scenario, engine_ends=True)
    assert harness.texts("lost") == ["the engine ends, and its queue: mine"]
