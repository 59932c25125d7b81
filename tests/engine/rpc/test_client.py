"""A client and an engine in two processes, as in the window."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.engine.rpc.client import (
    EngineClient,
    EngineRefusal,
    StopResult,
    stop_engines,
)
from rigctl.engine.rpc.engine_files import (
    EngineFile,
    rig_name,
    running_engines,
    runtime_folder,
    write_engine_file,
)
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.engine.rpc.server import open_listener
from rigctl.errors import LinkLost, WrongUse


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep engine files in a folder of this test."""
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path))


def test_a_client_controls_a_rig_in_real_time() -> None:
    client = EngineClient.start("virtual")
    try:
        client.request("arm", timeout_s=30)
        status = client.request("status")
        assert set(status) == set(EngineStatus.__slots__)
        assert (status["rig"], status["simulated"]) == ("virtual", True)
        assert status["state_words"] == "armed, lifted"
        seen = client.live.taxel_head
        number = client.send("tare")
        events = client.wait(5)
        while not any(event.get("reply") == number for event in events):
            events += client.wait(5)
        assert any(event.get("event") == "status" for event in events)
        assert client.live.taxel_head > seen
        window = client.live.taxels(100)
        assert window.spikes.shape == (100, 36)
        assert client.live.drum(10).force_set_g[0] == status["force_set_g"]
        with pytest.raises(EngineRefusal, match="no run is active") as refusal:
            client.request("pause")
        assert refusal.value.exit_code == 2
        second = EngineClient.attach()
        assert second.request("status")["state_words"] == "armed, lifted"
        second.close()
    finally:
        assert client.shut_down() == 0
    assert running_engines(runtime_folder()) == []


def test_a_client_that_leaves_ends_nothing_under_another() -> None:
    first = EngineClient.start("virtual")
    second = EngineClient.attach()
    assert second.leave() is None
    assert first.request("status")["drum_connected"]
    third = EngineClient.attach()
    assert third.request("status")["drum_connected"]
    assert first.leave() is None
    assert third.request("status")["drum_connected"]
    third.leave()
    assert first.process is not None and first.process.wait(60) == 0
    assert running_engines(runtime_folder()) == []


def test_the_last_client_that_leaves_ends_the_engine() -> None:
    assert EngineClient.start("virtual").leave() == 0
    assert running_engines(runtime_folder()) == []


def test_the_client_reports_why_a_rig_cannot_be_opened() -> None:
    with pytest.raises(EngineRefusal, match=r"there is no rig absent\.toml") as refusal:
        EngineClient.start("absent.toml")
    assert refusal.value.exit_code == 2


def test_a_board_that_does_not_answer_gives_the_exit_code(tmp_path: Path) -> None:
    description = tmp_path / "rig.toml"
    description.write_text('[ports]\ndrum = "tcp://127.0.0.1:9"\ntaxels = "tcp://127.0.0.1:9"\n')
    with pytest.raises((EngineRefusal, LinkLost)) as refusal:
        EngineClient.start(str(description))
    assert refusal.value.exit_code == 3
    assert running_engines(runtime_folder()) == []


def test_a_bench_that_has_an_engine_gets_no_second_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither by another way to the same file; engines of other rigs do not matter."""
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text('[ports]\ndrum = "tcp://127.0.0.1:9"\ntaxels = "tcp://127.0.0.1:9"')
    with open_listener() as listener:
        port, rig = listener.getsockname()[1], rig_name("rig.toml")
        engine = EngineFile("first", os.getpid(), port, "", rig, "")
        write_engine_file(runtime_folder(), engine)
        with pytest.raises(EngineRefusal, match=r"an engine holds .*rig\.toml already") as refusal:
            EngineClient.start("./rig.toml")
    assert refusal.value.exit_code == 2


def test_an_engine_of_another_version_is_not_joined_and_is_stopped() -> None:
    client = EngineClient.start("virtual")
    client.request("arm", timeout_s=30)
    other = replace(client.engine_file, version="0.0.9")
    write_engine_file(runtime_folder(), other)
    with pytest.raises(WrongUse, match=r"is of rigctl 0\.0\.9 and this is .* STOP reaches it"):
        EngineClient.attach()
    results: list[StopResult] = []
    assert stop_engines(results.append) == 1 and results[0].failure == ""
    assert client.shut_down() == 0


def test_attach_without_an_engine_is_refused() -> None:
    with pytest.raises(WrongUse, match="no engine is running"):
        EngineClient.attach()
