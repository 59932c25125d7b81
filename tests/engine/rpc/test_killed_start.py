"""An engine that is killed while it starts, or has no room to: a sentence, and the next one starts.

The folder for running engines has no room where the system lets no file grow.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from rigctl.engine.rpc import client as client_module
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import (
    ENGINE_FILE,
    LIVE,
    LOG,
    EngineFile,
    running_engines,
    runtime_folder,
    write_engine_file,
)
from rigctl.engine.rpc.server import open_listener
from rigctl.errors import LinkLost, RigctlError, WrongUse
from rigctl.session.part import existing_parts
from tests.cli.processes import ONE, finished, rigctl
from tests.waiting import until


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder for running engines of this test."""
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path))
    return runtime_folder()


def kill_when_there(monkeypatch: pytest.MonkeyPatch, ending: str) -> threading.Thread:
    """Kill the next engine when its file with this ending appears; return the thread that waits."""
    started: list[tuple[Path, int]] = []
    spawn = client_module.spawn_engine

    def spawned(folder: Path, name: str, *args: Any) -> object:
        process, log = spawn(folder, name, *args)
        started.append((folder / (name + ending), process.pid))
        return process, log

    def kill() -> None:
        path, pid = until(lambda: started and started[0])
        until(path.exists)
        os.kill(pid, signal.SIGKILL)

    monkeypatch.setattr(client_module, "spawn_engine", spawned)
    thread = threading.Thread(target=kill)
    thread.start()
    return thread


@pytest.mark.skipif(sys.platform == "win32", reason="signals are of Unix")
@pytest.mark.parametrize("ending", [LOG, LIVE, ENGINE_FILE])
def test_an_engine_that_is_killed_while_it_starts_leaves_nothing_in_the_way(
    runtime: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    with monkeypatch.context() as patch:
        thread = kill_when_there(patch, ending)
        with pytest.raises(RigctlError, match=r"killed while it started|lost|ended|not answer"):
            EngineClient.start("virtual")
        thread.join()
    assert running_engines(runtime) == []
    assert {path.suffix for path in runtime.iterdir()} <= {LOG}
    EngineClient.start("virtual").leave()


@pytest.mark.skipif(sys.platform == "win32", reason="signals are of Unix")
def test_a_run_that_is_killed_before_it_records_begins_again_in_its_folder(
    tmp_path: Path,
) -> None:
    (tmp_path / "one.toml").write_text(ONE)
    words = "run", str(tmp_path / "one.toml"), "--out", str(tmp_path / "s"), "--yes"
    with subprocess.Popen(rigctl(*words), stderr=subprocess.PIPE, text=True) as process:
        until((tmp_path / "s" / "writer.lock").exists)
        (engine,) = running_engines(runtime_folder())
        os.kill(engine.pid, signal.SIGKILL)
        assert process.wait() != 0
        assert process.stderr is not None and "Traceback" not in process.stderr.read()
    for name in ("part-0001.new", "rig.toml.partial"):  # what it leaves where these were being made
        (tmp_path / "s" / name).touch()
    if existing_parts(tmp_path / "s"):  # it had begun to record
        words = "run", "--resume", str(tmp_path / "s"), "--yes"
    ended = finished(*words)
    assert ended.returncode == 0, ended.stderr
    assert "1 of 1 trials committed" in ended.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="signals are of Unix")
def test_a_crash_of_native_code_is_named_with_its_report(runtime: Path) -> None:
    """faulthandler writes where Python was into the engine's log, which stays."""
    client = EngineClient.start("virtual")
    os.kill(client.engine_file.pid, signal.SIGSEGV)
    with pytest.raises(LinkLost, match="please send its crash report") as lost:
        while True:
            client.wait(10.0)
    client.close()
    report = Path(str(lost.value).rpartition(": ")[2])
    assert report.parent == runtime and "Segmentation fault" in report.read_text()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of files are of Unix")
@pytest.mark.parametrize("words", [["run", "one.toml", "--out", "s"], ["jog", "1", "--rig", "r"]])
def test_a_folder_without_room_is_told_in_a_sentence(
    runtime: Path, tmp_path: Path, words: list[str]
) -> None:
    (tmp_path / "one.toml").write_text(ONE)
    (tmp_path / "r").write_text("")
    command = " ".join(rigctl(*words))
    ended = subprocess.run(
        ["sh", "-c", f"ulimit -f 0; exec {command}"], cwd=tmp_path, capture_output=True, text=True
    )
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"rigctl: the folder for running engines {runtime} takes no")
    assert "make room there, or set RIGCTL_RUNTIME" in ended.stderr
    assert ended.stderr.count("\n") == 1
    assert list(runtime.iterdir()) == [] and not (tmp_path / "s").exists()


def refuse(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("call", ["open", "fdopen"])
def test_an_engine_that_cannot_be_announced_says_why(
    runtime: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    with open_listener() as listener:
        engine = EngineFile("one", os.getpid(), listener.getsockname()[1], "t", "virtual", "")
        monkeypatch.setattr(os, call, refuse)
        with pytest.raises(WrongUse, match=r"takes no files .No space left on device.: make room"):
            write_engine_file(runtime, engine)
