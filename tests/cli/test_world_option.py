"""``--world`` of every command with a simulated rig: used, stored in the session, or refused."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
import serial

from gui.app import main as window
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.cli import main
from rigctl.session.session import Session
from tests.cli.processes import LIMIT_S, ONE, finished, rigctl
from tests.waiting import until

LAB = "start_mm = 100\ncircumference_mm = 420\n"


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with protocols, worlds (one invalid), a real rig and a simulated one."""
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path / "runtime"))
    monkeypatch.chdir(tmp_path)
    texts = {
        "one": ONE,
        "three": ONE.replace("repeats = 1", "repeats = 3"),
        "lab": LAB,
        "other": "start_mm = 120\ncircumference_mm = 420\n",
        "wrong": "\nstart_inch = 3\n",
        "real": f'[ports]\ndrum = "/dev/none"\n[taxels]\nwiring = {list(range(18))}\n',
        "rehearsal": '[ports]\nsimulate = "virtual"\n',
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


def stored_world(folder: Path) -> dict[str, object]:
    """Return world and file name of a session, which all its parts store alike."""
    with Session.open(folder) as session:
        worlds = [json.dumps(part.header.simulation) for part in session.parts]
    assert len(set(worlds)) == 1
    return dict(json.loads(worlds[0]))


@pytest.mark.parametrize(
    "command",
    [
        ("run", "one.toml", "--out", "session"),
        ("serve",),
        ("synth", "--plan", "one.toml", "--seed", "1", "--out", "session"),
        ("demo", "--no-window", "--out", "session"),
        ("calibrate", "--rig", "virtual", "imbalance"),
        ("world", "wrong.toml"),
    ],
    ids=lambda command: command[0],
)
def test_invalid_world_is_refused_with_its_line_before_anything_is_written(
    place: Path, command: tuple[str, ...]
) -> None:
    option = () if command[0] == "world" else ("--world", "wrong.toml")
    done = finished(command[0], *option, *command[1:])
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == (
        "rigctl: wrong.toml, line 2: start_inch: no such parameter; did you mean 'start_mm', in mm?"
    )
    assert not (place / "session").exists()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--world", "wrong.toml"], "wrong.toml, line 2: start_inch"),
        (["--world", "lab.toml", "--rig", "join"], "already has a world"),
    ],
)
def test_window_does_not_open_with_an_invalid_world(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], args: list[str], words: str
) -> None:
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    assert window(args) == 2
    assert words in capsys.readouterr().err


def test_a_real_rig_has_no_world_file(place: Path) -> None:
    done = finished("run", "one.toml", "--rig", "real.toml", "--world", "lab.toml", "--out", "s")
    assert done.returncode == 2
    assert done.stderr.startswith("rigctl: real.toml describes a real rig")
    assert not (place / "s").exists()


def test_run_stores_its_world_and_refuses_another_on_resume(place: Path) -> None:
    session = place / "session"
    arguments = [
        *("run", "three.toml", "--rig", "rehearsal.toml", "--world", "lab.toml"),
        *("--out", "session", "--yes", "--json"),
    ]
    with subprocess.Popen(
        rigctl(*arguments), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        until((session / "part-0001.h5").exists)
        process.send_signal(signal.SIGINT)
        assert process.wait(LIMIT_S) == 130
    before = sorted(path.name for path in session.iterdir())

    refused = finished("run", "--resume", "session", "--world", "other.toml", "--yes")
    assert refused.returncode == 2
    assert "start_mm is 100.0 there and 120.0 here" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert sorted(path.name for path in session.iterdir()) == before

    assert finished("run", "--resume", "session", "--yes").returncode == 0
    simulation = stored_world(session)
    assert simulation["world_file"] == "lab.toml"
    assert isinstance(simulation["world"], dict)
    assert simulation["world"]["start_mm"] == 100.0


def test_data_set_stores_its_world_and_refuses_another_on_resume(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["synth", "--plan", "one.toml", "--seed", "1", "--out", "set"]
    assert main([*command, "--world", "lab.toml"]) == 0
    simulation = stored_world(place / "set")
    assert simulation["world_file"] == "lab.toml"
    assert main([*command, "--world", "lab.toml", "--resume"]) == 0
    capsys.readouterr()
    assert main([*command, "--resume"]) == 2
    assert "set was recorded in another world, circumference_mm is 420.0" in capsys.readouterr().err


def test_world_of_a_session_can_be_printed_and_used_again(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["synth", "--seed", "1", "--out", "x", "--plan", "one.toml"]) == 0
    capsys.readouterr()
    assert main(["world", "x"]) == 0
    nominal = capsys.readouterr().out
    assert main(["world"]) == 0
    assert capsys.readouterr().out == nominal
    (place / "again.toml").write_text(nominal)
    assert main(["world", "again.toml"]) == 0
    assert capsys.readouterr().out == nominal


def test_served_boards_use_the_world(place: Path) -> None:
    (place / "worn.toml").write_text("stuck_taxels = [3, 16]\n")
    with subprocess.Popen(
        rigctl("serve", "--world", "worn.toml", "--json"),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["taxels"]["tcp"]
        with serial.serial_for_url(f"socket://{address}", timeout=LIMIT_S) as port:
            (block,) = FrameDecoder(18).feed(port.read(33 * 20), 0.0).blocks
        assert np.flatnonzero(block.samples[-1] > 300).tolist() == [3, 16]
        process.send_signal(signal.SIGINT)
        assert process.wait(LIMIT_S) == 0
