"""The runtime folder is the user's alone, and nothing is removed but what engines made in it."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from rigctl.cli import main
from rigctl.engine.rpc.engine_files import (
    ABANDONED_S,
    FOLDER_VARIABLE,
    EngineFile,
    engine_file_path,
    read_engine_file,
    running_engines,
    runtime_folder,
    write_engine_file,
)
from rigctl.engine.rpc.server import open_listener
from rigctl.errors import WrongUse


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    return runtime_folder()


def engine_at(folder: Path, listener: socket.socket, name: str = "one") -> EngineFile:
    address = listener.getsockname()
    at: dict[str, Any] = {"port": 0, "socket": address}
    if not isinstance(address, str):
        at = {"port": address[1]}
    live = str(folder / f"{name}.live")
    return EngineFile(name, os.getpid(), token="t", rig="virtual", live=live, **at)


def ended_process() -> int:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


def test_the_folder_is_private(folder: Path) -> None:
    assert folder.stat().st_mode & 0o777 == 0o700
    assert runtime_folder() == folder


def make_open(folder: Path) -> None:
    folder.chmod(0o755)


def make_link(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


def make_file(folder: Path) -> None:
    folder.rmdir()
    folder.write_text("")


@pytest.mark.parametrize(
    ("change", "cure"),
    [(make_open, "run chmod 700"), (make_link, "remove it"), (make_file, "remove it")],
)
def test_a_folder_that_is_not_ours_alone_is_refused(
    folder: Path,
    change: Callable[[Path], None],
    cure: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(folder)
    assert main(["stop"]) == 2
    assert cure in capsys.readouterr().err
    with pytest.raises(WrongUse):
        runtime_folder()


def test_a_folder_of_another_user_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    folder.rename(folder.with_name(f"rigctl-{user + 1}"))
    with pytest.raises(WrongUse, match="belongs to another user"):
        runtime_folder()


@pytest.mark.parametrize(
    "changes",
    [
        {"live": "PRECIOUS"},
        {"socket": "PRECIOUS"},
        {"live": "../precious"},
        {"live": 7},
        {"name": "../precious"},
        {"name": "other"},
        {"name": ["one"]},
        {"pid": 0},
        {"pid": -1},
        {"pid": 1 << 40},
        {"pid": 10**400},
        {"pid": "1"},
        {"port": 1 << 16},
        {"port": -1},
        {"port": True},
        {"token": None},
        {"token": "t" * 1000},
        {"rig": "\x1b[2J"},
        {"rig": "a\nb"},
    ],
    ids=str,
)
def test_a_planted_engine_file_is_ignored_and_deletes_nothing(
    folder: Path, tmp_path: Path, changes: dict[str, Any]
) -> None:
    """``rigctl stop`` once removed the file that a planted one called its live data."""
    precious = tmp_path / "precious"
    precious.write_text("data")
    dead = EngineFile("one", ended_process(), 9, "t", "virtual", str(folder / "one.live"))
    changes = {k: str(precious) if v == "PRECIOUS" else v for k, v in changes.items()}
    engine_file_path(folder, "one").write_text(json.dumps({**asdict(dead), **changes}))
    assert main(["stop"]) == 1
    assert precious.read_text() == "data"


@pytest.mark.parametrize(
    "content", [b"", b"[" * 60_000, b"\xff", b"null", b"[]", b'{"pid":NaN}', b"{" * 1_000_000]
)
def test_an_engine_file_that_is_none_is_ignored(folder: Path, content: bytes) -> None:
    engine_file_path(folder, "one").write_bytes(content)
    assert running_engines(folder) == []


def test_a_pipe_and_a_folder_in_place_of_the_file_are_ignored(folder: Path) -> None:
    os.mkfifo(engine_file_path(folder, "pipe"))
    engine_file_path(folder, "folder").mkdir()
    assert running_engines(folder) == []


def test_the_file_is_written_and_read(folder: Path) -> None:
    with open_listener() as listener:
        engine = engine_at(folder, listener)
        path = write_engine_file(folder, engine)
        assert path.stat().st_mode & 0o777 == 0o600
        assert read_engine_file(path) == engine
        assert running_engines(folder) == [engine]


@pytest.mark.parametrize("has_port", [False, True])
def test_another_process_with_the_pid_of_a_dead_engine_keeps_nothing(
    folder: Path, has_port: bool
) -> None:
    """The process id is that of the test, as the system may give it to anybody."""
    with open_listener(None if has_port else folder / "one.sock") as listener:
        engine = engine_at(folder, listener)
        write_engine_file(folder, engine)
        (folder / "one.live").touch()
        assert running_engines(folder) == [engine]
    assert running_engines(folder) == []
    assert list(folder.iterdir()) == []


def test_the_files_of_a_dead_engine_are_removed_but_its_log(folder: Path) -> None:
    with open_listener(folder / "one.sock") as listener:
        engine = replace(engine_at(folder, listener), pid=ended_process())
        engine_file_path(folder, "one").write_text(json.dumps(asdict(engine)))
        for ending in ("live", "engine.draft", "log"):
            (folder / f"one.{ending}").touch()
        assert running_engines(folder) == []
    assert [path.name for path in folder.iterdir()] == ["one.log"]


def test_a_new_engine_removes_what_is_abandoned(folder: Path) -> None:
    for name in ("old.log", "old.live", "old.sock", "old.engine.draft", "notes.txt", "a b.log"):
        path = folder / name
        path.touch()
        os.utime(path, (1.0, path.stat().st_mtime - ABANDONED_S - 60))
    (folder / "new.log").touch()
    (folder / "folder.log").mkdir()
    with open_listener() as listener:
        write_engine_file(folder, engine_at(folder, listener))
    left = {path.name for path in folder.iterdir()}
    assert left == {"notes.txt", "a b.log", "new.log", "folder.log", "one.engine.json"}


@pytest.mark.parametrize("name", ["", "../x", "a/b", "a b", "é", "x" * 65, "a\n", "a\0b"])
@pytest.mark.parametrize("command", ["engine", "finger-engine"])
def test_an_engines_name_has_safe_letters(
    folder: Path, command: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--rig", "virtual", f"--name={name}"]) == 2
    assert "cannot be an engine's name" in capsys.readouterr().err
    assert list(folder.iterdir()) == []


def test_a_name_that_a_running_engine_has_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_listener(folder / "one.sock") as listener:
        write_engine_file(folder, engine_at(folder, listener))
        assert main(["engine", "--rig", "virtual", "--name", "one"]) == 2
    assert "an engine named one runs already" in capsys.readouterr().err
    assert engine_file_path(folder, "one").exists()
