"""Several clients of one engine: one has control, the others watch, and STOP works from each."""

from __future__ import annotations

from typing import Any

import pytest

from rigctl.boards.drum_states import State
from tests.engine.engine_harness import EngineHarness
from tests.engine.rpc.client_connection import ClientConnection

ANNA, BEN = "window of anna on lab", "window of ben on lab"


def holder(message: dict[str, Any]) -> str:
    """Return the name of the client that has control."""
    data = message.get("data", message)
    names = {client["id"]: client["name"] for client in data["clients"]}
    return str(names.get(data["holder"], ""))


async def two_clients(harness: EngineHarness) -> tuple[ClientConnection, ClientConnection]:
    anna = await ClientConnection.connect(harness.address, ANNA)
    return anna, await ClientConnection.connect(harness.address, BEN)


async def test_the_first_client_has_control_and_the_others_watch(harness: EngineHarness) -> None:
    anna, ben = await two_clients(harness)
    told = await ben.until("control")
    assert holder(told) == ANNA and told["text"] == f"{BEN} has joined and watches"
    refusal = await ben.refusal("arm")
    assert refusal.startswith(f"{ANNA} has control and this client only watches")
    assert "take it first" in refusal
    await anna.request("arm")
    assert harness.engine.status().state is State.ARMED
    await ben.request("status")
    await ben.request("stop")
    await harness.until(lambda: bool(harness.texts("stop")))
    await anna.close()
    await ben.close()


async def test_control_is_asked_for_and_given(harness: EngineHarness) -> None:
    anna, ben = await two_clients(harness)
    await anna.until("control")
    await ben.request("ask_control")
    asked = await anna.until("control")
    while not asked["data"]["asking"]:
        asked = await anna.until("control")
    assert asked["text"] == f"{BEN} asks for control; {ANNA} has it"
    assert "has control" in await ben.refusal("arm")
    assert "has control" in await ben.refusal("give_control", to=1)
    assert "there is no client 99" in await anna.refusal("give_control", to=99)
    await anna.request("give_control", to=asked["data"]["asking"][0])
    assert BEN in await anna.refusal("arm")
    await ben.request("arm")
    await anna.close()
    await ben.close()


async def test_control_is_taken_and_everyone_is_told(harness: EngineHarness) -> None:
    anna, ben = await two_clients(harness)
    await ben.request("take_control")
    while holder(told := await anna.until("control")) != BEN:
        pass
    assert told["text"] == f"{BEN} has taken control from {ANNA}"
    await ben.request("arm")
    assert BEN in await anna.refusal("disarm")
    await anna.close()
    await ben.close()


@pytest.mark.parametrize("has_asked", [True, False])
async def test_control_of_a_client_that_leaves_is_free(
    harness: EngineHarness, has_asked: bool
) -> None:
    anna, ben = await two_clients(harness)
    if has_asked:
        await ben.request("ask_control")
    await anna.close()
    while "has left" not in (told := await ben.until("control"))["text"]:
        pass
    assert holder(told) == (BEN if has_asked else "")
    await ben.request("arm")
    assert harness.engine._server.control.state.holder is not None
    await ben.close()


async def test_a_program_without_a_name_gets_control_where_nobody_has_it(
    harness: EngineHarness,
) -> None:
    program = await ClientConnection.connect(harness.address)
    await program.request("arm")
    anna = await ClientConnection.connect(harness.address, ANNA)
    assert "client 1 has control" in await anna.refusal("tare")
    await program.close()
    await anna.close()


async def test_who_joins_gets_the_log_so_far(harness: EngineHarness) -> None:
    anna = await ClientConnection.connect(harness.address, ANNA)
    await anna.request("stop")
    harness.engine.event_bus.publish("batch", "every 100 ms")
    ben = await ClientConnection.connect(harness.address, BEN)
    await harness.wait(1.0)
    events = (await ben.request("history"))["events"]
    texts = [event["text"] for event in events]
    assert f"stopped by {ANNA}" in texts and f"{BEN} has joined and watches" in texts
    assert "every 100 ms" not in texts
    assert texts.index(f"stopped by {ANNA}") < texts.index(f"{BEN} has joined and watches")
    assert all(event["age_s"] >= 1.0 for event in events)
    assert (await ben.request("history", count=0))["events"] == []
    assert "count" in await ben.refusal("history", count=501)
    await anna.close()
    await ben.close()


@pytest.mark.parametrize("name", ["", "n" * 81, "a\nb", "\x1b[2J", 7, None])
async def test_a_name_is_one_short_line(harness: EngineHarness, name: object) -> None:
    client = await ClientConnection.connect(harness.address)
    assert "name" in await client.refusal("introduce", name=name)
    await client.close()


async def test_a_client_ends_no_engine_under_another(harness: EngineHarness) -> None:
    anna, ben = await two_clients(harness)
    assert await ben.request("leave") == {"ends": False}
    assert "has control" in await ben.refusal("shutdown")
    await ben.close()
    await anna.until("control")
    await anna.request("arm")
    await anna.close()


def test_a_connection_that_only_brings_a_stop_keeps_no_engine(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        anna, stop, ben = [await ClientConnection.connect(harness.address) for _ in range(3)]
        await stop.request("stop")
        assert await anna.request("leave") == {"ends": False}  # Ben may be about to join
        await ben.request("introduce", name=BEN)
        await ben.close()
        while "has left" not in (await anna.until("control"))["text"]:
            pass
        await anna.request("stop")
        try:
            assert await anna.request("leave") == {"ends": True}
            await harness.wait(60)
        finally:
            await anna.close()
            await stop.close()

    harness.run(scenario, engine_ends=True)


def test_a_run_goes_on_when_its_last_client_leaves(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        anna = await ClientConnection.connect(harness.address, ANNA)
        assert await anna.request("leave") == {"ends": False}
        await anna.close()
        await harness.until(harness.has_ended, 10_000)
        assert harness.engine.status().run.state == "done"

    harness.run(scenario, harness.request())
