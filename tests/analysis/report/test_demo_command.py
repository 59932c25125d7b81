"""The demo's last lines: where everything is, and when a window opens."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from rigctl.cli import demo, main
from rigctl.engine.rpc.messages import RunStatus
from rigctl.session.verify import VerifyReport
from tests.analysis.recordings import record


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A finished session in place of the engine's."""
    folder = record(tmp_path / "session", "AB", travel_mm=24.0)
    ended = RunStatus(state="done", session=str(folder))
    monkeypatch.setattr(demo, "_record", lambda *_: ended)
    monkeypatch.setattr(demo, "verify", lambda _: VerifyReport(samples=7, trials_committed=12))
    return folder


def test_results_are_named_one_a_line(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--no-window"]) == 0
    lines = capsys.readouterr().out.splitlines()
    paths = dict(line.split(": ", 1) for line in lines[-4:])
    assert list(paths) == ["session", "digest", "raster", "accuracy"]
    assert Path(paths["session"]) == session
    assert Path(paths["raster"]).is_file() and Path(paths["accuracy"]).is_file()
    assert "held-out accuracy" in lines[-5] and "chance 50.0%" in lines[-5]
    assert "simulated bench" in lines[-5]


def test_a_window_opens_only_with_a_display(
    session: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[list[str]] = []

    def crash(command: list[str], check: bool) -> subprocess.CompletedProcess[bytes]:
        opened.append(command[1:])
        return subprocess.CompletedProcess(command, -6)

    monkeypatch.setattr(demo.subprocess, "run", crash)
    monkeypatch.setattr(demo.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert main(["demo"]) == 0
    assert opened == []
    monkeypatch.setenv("DISPLAY", ":7")
    assert main(["demo"]) == 0
    assert opened == [["-m", "rigctl", "gui", "--rig", "virtual"]]
    assert "libxcb-cursor0" in capsys.readouterr().err


def test_a_damaged_session_is_reported(
    session: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "verify", lambda _: VerifyReport(problems=["part-0001.h5: torn"]))
    assert main(["demo", "--no-window"]) == 1
    assert "part-0001.h5: torn" in capsys.readouterr().err


@pytest.mark.parametrize(("state", "code"), [("aborted", 130), ("failed", 3)])
def test_a_run_that_ends_early_says_where_its_session_is(
    state: str, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = RunStatus(state=state, text="stopped", session="/x")
    monkeypatch.setattr(demo, "_record", lambda *_: ended)
    assert main(["demo"]) == code
    assert capsys.readouterr().out == "the run ended early: stopped\nsession: /x\n"
