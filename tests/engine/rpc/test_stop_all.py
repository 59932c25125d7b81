"""STOP for all engines in parallel, with a result for each."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.engine.rpc import client
from rigctl.engine.rpc.client import StopResult, stop_engines
from rigctl.engine.rpc.engine_files import (
    FOLDER_VARIABLE,
    EngineFile,
    runtime_folder,
    write_engine_file,
)
from rigctl.engine.rpc.messages import decode_message, encode_message
from rigctl.engine.rpc.server import open_listener


@pytest.fixture(autouse=True)
def nothing_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))


def announced(name: str, listener: socket.socket) -> None:
    port = listener.getsockname()[1]
    write_engine_file(runtime_folder(), EngineFile(name, os.getpid(), port, "", name, ""))


class ReplyServer:
    """A server that accepts one client, replies to it and records its command."""

    def __init__(self, name: str) -> None:
        self.commands: list[str] = []
        self._listener = open_listener()
        self._listener.setblocking(True)
        announced(name, self._listener)
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        while not self.commands:
            self._serve_one()

    def _serve_one(self) -> None:
        connection, _ = self._listener.accept()
        with connection, connection.makefile("rb") as lines:
            if not next(lines, b""):
                return  # somebody has looked whether the engine is there
            request = decode_message(next(lines))
            self.commands.append(request["command"])
            answer = {"reply": request["id"], "ok": True, "result": {}}
            connection.sendall(encode_message(answer))


@pytest.fixture
def engines() -> Iterator[list[ReplyServer]]:
    made = [ReplyServer("one"), ReplyServer("two")]
    yield made
    for engine in made:
        engine.close()


def test_every_engine_is_stopped(engines: list[ReplyServer]) -> None:
    results: list[StopResult] = []
    assert stop_engines(results.append) == 2
    assert {(each.rig, each.failure) for each in results} == {("one", ""), ("two", "")}
    assert [engine.commands for engine in engines] == [["stop"], ["stop"]]


def test_an_engine_that_hangs_does_not_delay_the_others(
    engines: list[ReplyServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "STOP_TIMEOUT_S", 2.0)
    results: list[StopResult] = []
    with open_listener() as mute:
        announced("mute", mute)  # the newest, so the first to be stopped
        stop_engines(results.append)
    assert results[-1].rig == "mute"
    assert [bool(each.failure) for each in results] == [False, False, True]


def test_the_command_reports_each_result(
    engines: list[ReplyServer],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(client, "STOP_TIMEOUT_S", 2.0)
    with open_listener() as mute:
        announced("mute", mute)
        assert main(["stop"]) == 3
    output = capsys.readouterr()
    pid = os.getpid()
    assert set(output.out.splitlines()) == {f"stopped: {n} (process {pid})" for n in ("one", "two")}
    assert output.err.startswith(f"rigctl: mute (process {pid}): no answer to 'stop'")


def test_excluded_engines_are_not_stopped(engines: list[ReplyServer]) -> None:
    results: list[StopResult] = []
    assert stop_engines(results.append, exclude=("one",)) == 1
    assert [each.rig for each in results] == ["two"]
    assert stop_engines(results.append, exclude=("two",)) == 1  # so that its thread ends


def test_without_an_engine_the_command_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stop"]) == 1
    assert "no engine is running" in capsys.readouterr().err
