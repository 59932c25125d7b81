"""The command of ``on_event`` gets what somebody must know; one that fails stops nothing."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from rigctl.config.rig_config import RigConfig, RunConfig
from rigctl.engine.event_hook import MAX_PROCESSES, EventHook
from rigctl.engine.rpc.messages import NOTHING_RECORDED_S
from rigctl.engine.runner import Run
from rigctl.session.verify import verify
from rigctl.values import Event
from tests.engine.engine_harness import TINY, EngineHarness, open_harness, until_ended
from tests.engine.protocol.test_interruptions import PAIR, until_turning
from tests.waiting import until

WRITE = "import json, sys; print(json.dumps(sys.argv[2:]), file=open(sys.argv[1], 'a'))"
DONE = Event(1.0, "run", "every trial is committed", {"state": "done"})


def writer(path: Path) -> tuple[str, ...]:
    """Return a command that appends its other arguments to a file."""
    return (sys.executable, "-c", WRITE, str(path))


def got(path: Path) -> list[list[str]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def told_by(command: Sequence[str], *events: Event, limit_s: float = 60.0) -> list[str]:
    """Return what is told of a command that gets these events, each after the one before."""
    told: list[str] = []
    hook = EventHook(command, told.append, limit_s)
    for event in events:
        hook(event)
        hook.close()
    return told


@pytest.mark.parametrize(
    ("kind", "data", "word"),
    [
        ("run", {"state": "failed"}, "failed"),
        ("pause", {"reason": "disk"}, "paused"),
        ("prompt", {"id": 1, "texture": "L"}, "plate"),
        ("prompt", {"id": 1, "texture": None}, "question"),
        ("fault", {"fault": 3}, "fault"),
        ("unrecorded", {}, "unrecorded"),
        ("run", {"session": "begins"}, None),
        ("pause", {"reason": "operator"}, None),
        ("fault", {}, None),
        ("hook", {}, None),
    ],
)
def test_the_command_gets_a_word_and_the_sentence(
    tmp_path: Path, kind: str, data: dict[str, Any], word: str | None
) -> None:
    path = tmp_path / "got"
    path.touch()
    sentence = 'what "happened"; $(touch x)\nand where'
    assert told_by((*writer(path), "rig 2"), Event(1.0, kind, sentence, data)) == []
    assert got(path) == ([["rig 2", word, sentence]] if word else [])


def test_without_a_command_nothing_runs() -> None:
    assert told_by((), DONE) == []


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["no-such-program"], "no-such-program cannot be started"),
        ([sys.executable, "-c", "import sys; sys.exit(3)"], "ended with exit code 3"),
    ],
)
def test_a_command_that_fails_is_told_once(command: Sequence[str], words: str) -> None:
    (text,) = told_by(command, DONE, DONE)
    assert words in text and "the run goes on" in text


def test_a_command_that_fails_again_is_told_again(tmp_path: Path) -> None:
    works = tmp_path / "works"
    command = [
        sys.executable,
        "-c",
        f"import os, sys; sys.exit(not os.path.exists({str(works)!r}))",
    ]
    told: list[str] = []
    hook = EventHook(command, told.append)
    for exists in (False, True, False):
        works.touch() if exists else works.unlink(missing_ok=True)
        hook(DONE)
        hook.close()
    assert len(told) == 2


@pytest.mark.skipif(sys.platform == "win32", reason="named pipes and groups are of Unix")
def test_a_command_that_hangs_is_killed_with_what_it_started(tmp_path: Path) -> None:
    pipe = tmp_path / "alive"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    script = f"sleep 1000 > {pipe} & exec sleep 1000 > {pipe}"
    (text,) = told_by(["sh", "-c", script], DONE, limit_s=0.5)
    assert "did not end within 0.5 s and was killed" in text
    until(lambda: is_without_writer(reader))
    os.close(reader)


def is_without_writer(reader: int) -> bool:
    try:
        return os.read(reader, 1) == b""
    except BlockingIOError:
        return False


def test_too_many_that_hang_are_told(tmp_path: Path) -> None:
    told: list[str] = []
    go_on = tmp_path / "go on"
    wait = f"import os, time\nwhile not os.path.exists({str(go_on)!r}): time.sleep(0.01)"
    hook = EventHook([sys.executable, "-c", wait], told.append, 60.0)
    for _ in range(MAX_PROCESSES + 2):
        hook(DONE)
    assert len(told) == 1 and "are not told" in told[0]
    go_on.touch()
    hook.close()
    assert len(told) == 1


def test_a_run_tells_its_plates_and_its_end(tmp_path: Path) -> None:
    path = tmp_path / "got"
    config = RigConfig(run=RunConfig(on_event=writer(path)))
    with open_harness(tmp_path, config=config) as harness:
        harness.run(answer_until_ended, harness.request(TINY, yes=False))
    words = sorted(line[0] for line in got(path))
    assert words == ["done", "plate", "plate"]


async def answer_until_ended(harness: EngineHarness) -> None:
    run = harness.engine.run
    assert run is not None
    while not run.ended:
        if run.control.prompt is not None:
            run.control.answer(run.control.prompt.id, "ok")
        await harness.wait(1)


def test_a_run_goes_on_beside_a_command_that_is_missing(tmp_path: Path) -> None:
    config = RigConfig(run=RunConfig(on_event=("no-such-program",)))

    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await until_turning(harness)
        run.control.pause("disk")  # ended by the engine, as the disk has room
        await harness.until(lambda: bool(harness.texts("hook")), 10_000)
        await until_ended(harness)
        assert run.outcome == "done"

    with open_harness(tmp_path, config=config) as harness:
        harness.run(scenario, harness.request(PAIR))
        assert len(harness.texts("hook")) == 1
        assert verify(harness.session).whole


def test_a_run_without_samples_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "got"
    configure = Run._configure

    async def long_configure(run: Run) -> None:
        await run.control.wait(3 * NOTHING_RECORDED_S)
        await configure(run)

    monkeypatch.setattr(Run, "_configure", long_configure)
    config = RigConfig(run=RunConfig(on_event=writer(path)))
    with open_harness(tmp_path, config=config) as harness:
        harness.run(until_ended, harness.request(PAIR))
        assert harness.texts("unrecorded") == ["no sample was recorded for 60 s: look at the rig"]
    assert sorted(line[0] for line in got(path)) == ["done", "unrecorded"]
