"""Windows join a rig in each of its states, and one that has control is killed in mid-run."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from PySide6.QtWidgets import QApplication

from gui.link.engine_link import JOIN
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.errors import WrongUse
from rigctl.session.verify import verify
from tests.gui.rig_window import TIMEOUT_MS, RigWindow, opened_window
from tests.gui.steps import click, wait_until

PROTOCOL = """
name = "joining"
textures = ["A", "B"]
speeds_mm_s = [80]
forces_g = [300]
repeats = 2
[trial]
travel_mm = 12
"""
RIG = """
[ports]
simulate = "virtual"
[signals]
index = false  # a run would look for the mark three times, which takes a quarter of a minute
"""
JOINING_WINDOWS = 3
Started = tuple[subprocess.Popen[bytes], list[EngineClient]]
OpenWindow = Callable[[], RigWindow]


class SharedRig(NamedTuple):
    """A rig whose window is a process of its own, and a client beside that window."""

    process: subprocess.Popen[bytes]
    client: EngineClient

    def do(self, command: str, **args: Any) -> dict[str, Any]:
        """Execute a command, and return its result."""
        return self.client.request(command, timeout_s=TIMEOUT_MS / 1000, **args)

    def until(self, done: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait for a status, and return it."""
        found: list[dict[str, Any]] = []

        def is_done() -> bool:
            found.append(self.do("status"))
            return done(found[-1])

        wait_until(is_done, TIMEOUT_MS)
        return found[-1]


@pytest.fixture
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Started]:
    """Yield a process of ``rigctl gui`` and a list for clients; all end with the test."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    words = [sys.executable, "-m", "rigctl", "gui", "--rig", str(path)]
    clients: list[EngineClient] = []
    with subprocess.Popen(words, stderr=subprocess.DEVNULL) as process:
        try:
            yield process, clients
        finally:
            process.kill()
            for client in clients:
                client.shut_down()


@pytest.fixture
def join(qapp: QApplication, started: Started) -> Iterator[OpenWindow]:
    """Yield what joins the rig with another window, and has the log of before.

    The windows are built while the rig starts, so ask for this fixture before ``rig``.
    """
    with ExitStack() as stack:
        windows = [stack.enter_context(opened_window()) for _ in range(JOINING_WINDOWS)]

        def join_another() -> RigWindow:
            opened = windows.pop()
            opened.connect(JOIN)
            opened.until(lambda: opened.window.attach.shared[0].number > 0)
            return opened

        yield join_another


@pytest.fixture
def rig(started: Started) -> SharedRig:
    """Return the rig that ``rigctl gui`` has started."""
    process, clients = started
    wait_until(lambda: _attached(clients), TIMEOUT_MS)
    rig = SharedRig(process, clients[0])
    wait_until(lambda: rig.do("clients")["holder"] is not None, TIMEOUT_MS)
    return rig


def _attached(clients: list[EngineClient]) -> bool:
    try:
        clients.append(EngineClient.attach())
    except WrongUse:
        return False
    return True


def take_control(opened: RigWindow) -> None:
    """Press the strip's button."""
    shared, strip = opened.window.attach.shared[0], opened.window.attach.controls[0]
    opened.until(strip.take.isVisible)
    click(strip.take)
    opened.until(lambda: shared.has_control)


def disconnect(opened: RigWindow) -> None:
    """Press Disconnect, and wait until the engine has answered."""
    click(opened.window.toolbar.connect_button)
    opened.window.engine_link.wait_closed()
    assert not opened.window.engine_link.left_running


def test_windows_join_in_each_state_and_outlive_the_one_that_has_control(
    join: OpenWindow, rig: SharedRig, tmp_path: Path
) -> None:
    killed = rig.do("clients")["holder"]
    rig.do("take_control")
    rig.do("set", speed_mm_s=70, force_g=250)
    for command in ("arm", "tare", "home", "approach"):
        rig.do(command)
    rig.until(lambda status: status["state"] == State.HOLD)

    in_hold = join()
    window = in_hold.window
    in_hold.until_state(State.HOLD)
    words = window.toolbar.state_words  # its age, where this computer is too busy for a new status
    in_hold.until(lambda: words.text() == in_hold.status.state_words)
    assert (in_hold.status.force_set_g, in_hold.status.speed_set_mm_s) == (250, 70)
    in_hold.until(lambda: in_hold.status.force_g > 100)
    in_hold.until(lambda: "in contact" in in_hold.log or "holding" in in_hold.log)
    assert not window.operate_panel.buttons["retract"].isEnabled()
    assert "has control" in window.operate_panel.buttons["retract"].toolTip()
    disconnect(in_hold)
    assert rig.do("status")["state"] == State.HOLD
    in_hold.connect(JOIN)

    rig.do("retract")
    protocol = tmp_path / "joining.toml"
    protocol.write_text(PROTOCOL)
    rig.do("start", protocol=str(protocol), out=str(tmp_path / "session"))
    prompt = rig.until(lambda status: status["run"]["prompt"])["run"]["prompt"]

    in_prompt = join()
    window = in_prompt.window
    in_prompt.until(window.prompt_panel.isVisible)
    assert window.prompt_panel.text.text() == prompt["text"]
    in_prompt.until(lambda: prompt["text"] in in_prompt.log)
    assert in_prompt.status.run.trials_planned == 4
    assert not window.prompt_panel.confirm.isEnabled()
    take_control(in_prompt)
    in_prompt.confirm()
    in_hold.until(in_hold.window.prompt_panel.isHidden)
    in_hold.until(lambda: in_hold.status.run.state == "running")

    in_prompt.window.engine_link.request("give_control", to=killed)
    in_prompt.until(lambda: not in_prompt.window.attach.shared[0].has_control)
    rig.until(lambda status: status["state"] == State.RUN)
    rig.process.kill()
    in_prompt.until(lambda: "has left; nobody has control" in in_prompt.log)
    committed = in_prompt.status.run.trials_committed
    (kept,) = (tmp_path / "config").rglob("window.ini")
    assert "docks=" in kept.read_text(), "layout and fields of a window that was killed return"
    plate = in_hold.window.operate_panel.bench.plate
    in_hold.until(lambda: plate.currentData() == "A")

    in_hold.until(lambda: in_hold.window.attach.shared[0].has_control)  # or its next click takes it
    pause = in_hold.window.protocol_panel.buttons["Pause"]
    in_hold.until(pause.isEnabled)
    click(pause)
    in_prompt.until(lambda: in_prompt.status.run.state == "paused")

    in_pause = join()
    window = in_pause.window
    in_pause.until(lambda: in_pause.status.run.state == "paused")
    assert in_pause.status.run.reasons == ("operator",)
    in_pause.until(lambda: "has left; nobody has control" in in_pause.log)
    take_control(in_pause)
    resume = window.protocol_panel.buttons["Resume"]
    in_pause.until(resume.isEnabled)
    click(resume)
    disconnect(in_hold)
    in_pause.confirm()  # the second plate
    in_prompt.until(lambda: in_prompt.status.run.state == "done")
    assert in_prompt.status.run.trials_committed == 4 > committed
    assert verify(tmp_path / "session").problems == []
