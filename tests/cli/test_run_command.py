"""``rigctl run`` and ``rigctl stop`` as processes: signals, exit codes, sessions."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.cli.run import _status_line
from rigctl.engine.rpc.client import EngineClient, EngineRefusal
from rigctl.engine.rpc.engine_files import EngineFile, running_engines, runtime_folder
from rigctl.engine.rpc.messages import EngineStatus, RunStatus
from rigctl.session.session import Session
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.cli.processes import LIMIT_S, ONE, finished, rigctl
from tests.waiting import until


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working folder with a protocol of one trial; engines are announced in it."""
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path / "runtime"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.toml").write_text(ONE)
    (tmp_path / "many.toml").write_text(ONE.replace("repeats = 1", "repeats = 500"))
    return tmp_path


def test_a_board_that_is_not_commissioned_is_refused_before_anything_is_asked(place: Path) -> None:
    ended = finished("run", "one.toml", "--out", "session", "--wire", "index missing")
    assert ended.returncode == 2
    assert "is not commissioned for its wiring" in ended.stderr and "rigctl setup" in ended.stderr
    assert "plate" not in ended.stderr and not (place / "session").exists()


@pytest.fixture
def running() -> Iterator[subprocess.Popen[str]]:
    """Yield a run of 500 trials that has committed the first."""
    process = subprocess.Popen(
        rigctl("run", "many.toml", "--out", "session", "--yes", "--json"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        watch(until_committed(1))
        yield process
        process.kill()


def the_engine() -> EngineFile:
    return until(lambda: running_engines(runtime_folder()))[0]


def until_committed(n: int) -> tuple[str, int]:
    return "trials_committed", n


def watch(goal: tuple[str, int]) -> None:
    """Wait until the run of the engine reaches a count."""
    client = EngineClient(the_engine())
    try:
        while True:
            for message in client.wait(1.0):
                if message.get("event") == "status" and message["data"]["run"][goal[0]] >= goal[1]:
                    return
    finally:
        client.close()


def committed(folder: Path) -> list[int]:
    with Session.open(folder) as session:
        return session.trials["trial_id"][session.committed()].tolist()


def on_disk(folder: Path) -> list[int]:
    """Return the trials that another process can read during the run, at least one."""
    return until(lambda: committed(folder))


def test_run_leaves_a_complete_session_and_prints_its_path(place: Path) -> None:
    said = (
        "--operator",
        "Jörg",
        "--plate-lot",
        "-3",
        "--project",
        "pilot",
        "--remarks",
        "cold room",
    )
    words = [f"{name}={text}" for name, text in zip(said[::2], said[1::2], strict=True)]
    done = finished("run", "one.toml", "--out", "session", "--yes", *words)
    assert done.returncode == 0, done.stderr
    kept = summarise_session(place / "session")
    assert tuple(kept[name[2:].replace("-", "_")] for name in said[::2]) == said[1::2]
    assert "session: session" in done.stdout.splitlines()
    assert verify(place / "session").whole
    assert committed(place / "session") == [1]
    assert running_engines(runtime_folder()) == []


def test_the_time_left_is_said_when_the_pace_is_known() -> None:
    """It once was 16 hours before the first of 32 trials on a virtual rig."""
    begun = RunStatus(state="running", trials_planned=32, eta_s=262.0, elapsed_s=0.01)
    assert "left" not in _status_line(EngineStatus(run=begun), 2.3)
    later = replace(begun, trials_committed=1, trial_age_s=0.0, eta_s=254.0, elapsed_s=8.0)
    assert "0:01:13 left" in _status_line(EngineStatus(run=later), 2.3)


def test_prompt_without_a_terminal_ends_the_run(place: Path) -> None:
    done = finished("run", "one.toml", "--out", "session")
    assert done.returncode == 130
    assert "--yes" in done.stderr


def test_end_of_input_during_a_prompt_ends_the_run(place: Path) -> None:
    """The run once waited forever if the input ended during a prompt."""
    with subprocess.Popen(
        rigctl("run", "one.toml", "--out", "session"),
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None and process.stderr is not None
        assert any("then confirm" in line for line in process.stderr)
        process.stdin.close()
        assert any("--yes" in line for line in process.stderr)
        assert process.wait(LIMIT_S) == 130


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (("run",), 2, "give either a protocol"),
        (("run", "absent.toml"), 2, "absent.toml"),
        (("run", "one.toml", "--rig", "nowhere.toml"), 2, "nowhere.toml"),
        (("run", "--resume", "."), 2, "not a session"),
        (("stop",), 1, "no engine is running"),
    ],
)
def test_wrong_use_prints_one_sentence_and_returns_its_code(
    args: tuple[str, ...], code: int, words: str
) -> None:
    done = finished(*args)
    assert done.returncode == code
    assert words in done.stderr
    assert done.stderr.startswith("rigctl: ")
    assert "Traceback" not in done.stderr


def test_ctrl_c_stops_safely_and_the_run_can_be_continued(
    place: Path, running: subprocess.Popen[str]
) -> None:
    running.send_signal(signal.SIGINT)
    out, _ = running.communicate(timeout=LIMIT_S)
    assert running.returncode == 130
    report = json.loads(out)
    assert report["state"] == "aborted"
    assert verify(place / "session").whole
    assert committed(place / "session") == list(range(1, report["trials_committed"] + 1))


def test_stop_from_another_terminal_ends_the_run(
    place: Path, running: subprocess.Popen[str]
) -> None:
    assert finished("stop").returncode == 0
    out, _ = running.communicate(timeout=LIMIT_S)
    assert json.loads(out)["text"].startswith("stopped by command line of ")
    assert running.returncode == 130
    assert verify(place / "session").whole


def test_a_killed_engine_leaves_a_session_that_opens(
    place: Path, running: subprocess.Popen[str]
) -> None:
    before = on_disk(place / "session")
    os.kill(the_engine().pid, signal.SIGKILL)
    _, errors = running.communicate(timeout=LIMIT_S)
    assert running.returncode == 3
    assert "session it wrote is kept" in errors
    assert committed(place / "session")[: len(before)] == before


def test_run_continues_without_its_client(place: Path, running: subprocess.Popen[str]) -> None:
    running.kill()
    running.communicate(timeout=LIMIT_S)
    watch(until_committed(3))
    client = EngineClient.attach()
    with pytest.raises(EngineRefusal, match="a run is active"):
        client.request("tare")
    assert client.live.taxel_head > 0
    engine = client.engine_file
    client.request("abort", timeout_s=60)
    client.shut_down()
    until(lambda: not running_engines(runtime_folder()))
    assert not Path(engine.live).exists()
    assert verify(place / "session").whole


def test_the_same_seed_gives_the_same_bits_in_two_processes(place: Path) -> None:
    recorded = []
    for name in ("first", "second"):
        assert finished("run", "one.toml", "--out", name, "--yes", "--seed", "7").returncode == 0
        with Session.open(place / name) as session:
            part = session.parts[0]
            recorded.append(part.read("/taxels/samples", 0, part.n_samples).tobytes())
    assert recorded[0] == recorded[1]
