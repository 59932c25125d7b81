"""``rigctl jog``, ``home``, ``tare`` and ``approach``, with and without an engine that runs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from rigctl import api
from rigctl.api import ConnectedRig
from rigctl.boards.drum_states import State
from rigctl.cli import main, move
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import (
    FOLDER_VARIABLE,
    EngineFile,
    running_engines,
    runtime_folder,
)

MOVED = {
    "jog -12.5": "the drum turned by -12.50 mm",
    "home": "the drum counts its steps from the index mark",
    "tare": "what the lifted load cell reads now is 0 g",
    "approach 300": "the drum has pressed, with ",
}


@pytest.fixture(autouse=True)
def no_other_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))


@pytest.fixture
def watching() -> Iterator[EngineClient]:
    """Return a client without control of an engine on the virtual rig."""
    client = EngineClient.start("virtual", paced=False)
    yield client
    client.shut_down()


def test_without_an_engine_the_rig_is_opened_for_one_move(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["jog", "-12.5", "--rig", "virtual"]) == 0
    assert capsys.readouterr().out == "the drum turned by -12.50 mm\n"
    assert running_engines(runtime_folder()) == []
    assert main(["approach", "5000", "--rig", "virtual"]) == 2
    assert "outside this rig's limits, 50 to 1200" in capsys.readouterr().err


def test_a_running_engine_makes_the_moves_and_leaves_the_drum_off(
    watching: EngineClient, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, said in MOVED.items():
        assert main(words.split()) == 0
        assert capsys.readouterr().out.startswith(said)
        assert watching.request("status")["state"] == State.IDLE


def test_an_armed_drum_stays_armed_and_whoever_has_control_keeps_it(
    watching: EngineClient, capsys: pytest.CaptureFixture[str]
) -> None:
    holder = EngineClient.join(watching.engine_file)
    holder.request("arm")
    assert main(["home", "--rig", "virtual"]) == 2
    assert "has control and this client only watches" in capsys.readouterr().err
    holder.close()
    assert main(["jog", "5"]) == 0
    assert watching.request("status")["state"] == State.ARMED


class Interrupted:
    """A client at which somebody presses Ctrl-C while the drum turns."""

    def __init__(self) -> None:
        self.sent: list[str] = []

    def request(self, command: str, **_: Any) -> dict[str, Any]:
        self.sent.append(command)
        if command == "jog":
            raise KeyboardInterrupt
        return {"state": State.IDLE}


def test_an_interrupt_stops_the_drum_before_anything_else() -> None:
    client = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        rig = ConnectedRig(cast(EngineClient, client), started=False)
        move._move(rig, argparse.Namespace(command="jog", mm=5.0))
    assert client.sent == ["status", "arm", "jog", "stop", "disarm"]


def test_which_rig_is_meant_must_be_clear(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["home"]) == 2
    assert "no engine is running: name the rig" in capsys.readouterr().err
    both = [EngineFile(name, 7, 0, "", name, "") for name in ("one", "two")]
    monkeypatch.setattr(api, "running_engines", lambda folder: both)
    assert main(["home"]) == 2
    assert "one (process 7), two (process 7): name one rig" in capsys.readouterr().err
