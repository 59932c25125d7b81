"""Engines that run before the window: announced, joined, shared, and left on purpose."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from gui.link.engine_link import JOIN
from gui.shell.main_window import MainWindow
from rigctl.engine.rpc import client
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, running_engines, runtime_folder
from tests.gui.running_engine import start_protocol
from tests.gui.steps import click, own_window, wait_until

TIMEOUT_MS = 120_000
OpenWindow = Callable[[], MainWindow]


@pytest.fixture(scope="module")
def running(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[EngineClient]:
    """Yield a client of an engine whose protocol goes on, as after a window that was closed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(tmp_path_factory.mktemp("attach")))
        engine = start_protocol(tmp_path_factory.mktemp("running"))
        yield engine
        engine.request("take_control")
        engine.shut_down()


@pytest.fixture
def open_window(running: EngineClient) -> Iterator[OpenWindow]:
    """Yield what opens a window at the size of a small screen; all are closed at the end."""
    with ExitStack() as stack:

        def open_one() -> MainWindow:
            window = stack.enter_context(own_window())
            window.resize(1024, 700)
            window.show()
            stack.callback(window.attach.leave)
            return window

        yield open_one


def joined(window: MainWindow) -> MainWindow:
    """Let a window announce the engine, and join it."""
    window.attach.announce()
    wait_until(window.attach.engines.isVisible, TIMEOUT_MS)
    click(window.attach.engines.join_buttons[-1])
    wait_until(lambda: window.attach.shared[0].number > 0, TIMEOUT_MS)
    return window


def test_a_window_tells_of_the_run_and_joins_it(
    running: EngineClient, open_window: OpenWindow
) -> None:
    """It told of nothing, and its log was empty after it had joined."""
    window = open_window()
    window.attach.announce()
    wait_until(window.attach.engines.isVisible, TIMEOUT_MS)
    engines = window.attach.engines
    assert "1 engine runs already" in engines.text.text()
    row = engines.join_buttons[0].toolTip()
    assert f"process {running.engine_file.pid}" in row
    click(engines.join_buttons[0])
    wait_until(lambda: window.engine_link.status.run.is_active, TIMEOUT_MS)
    wait_until(lambda: "the run begins" in window.event_log.toPlainText())
    assert not engines.isVisible()


def test_connect_starts_no_second_engine_silently(
    running: EngineClient, open_window: OpenWindow
) -> None:
    window = open_window()
    window.toolbar.rig.choose("virtual")
    click(window.toolbar.connect_button)
    engines = window.attach.engines
    wait_until(engines.isVisible, TIMEOUT_MS)
    assert "runs already" in engines.text.text()
    assert len(running_engines(runtime_folder())) == 1
    assert window.toolbar.connect_button.text() == "Connect"
    click(engines.start_button)
    wait_until(lambda: window.engine_link.live is not None, TIMEOUT_MS)
    assert len(running_engines(runtime_folder())) == 2
    second = open_window()
    second.toolbar.rig.choose(JOIN)
    click(second.toolbar.connect_button)
    wait_until(second.attach.engines.isVisible, TIMEOUT_MS)
    assert len(second.attach.engines.join_buttons) == 2
    click(window.toolbar.connect_button)
    window.engine_link.wait_closed()
    assert [e.name for e in running_engines(runtime_folder())] == [running.engine_file.name]


def test_two_windows_share_the_control(running: EngineClient, open_window: OpenWindow) -> None:
    first, second = joined(open_window()), joined(open_window())
    has, watches = first.attach.controls[0], second.attach.controls[0]
    wait_until(watches.isVisible)
    assert "has control" in watches.text.text() and not has.isVisible()
    pause, resume = (second.protocol_panel.buttons[name] for name in ("Pause", "Resume"))
    assert first.protocol_panel.buttons["Pause"].isEnabled()
    assert not pause.isEnabled() and "has control: ask for it" in pause.toolTip()
    assert second.toolbar.stop_button.isEnabled()
    second.engine_link.request("pause")
    wait_until(lambda: "this client only watches" in second.event_log.toPlainText())
    click(watches.ask)
    wait_until(has.isVisible)
    assert "asks for control" in has.text.text() and not watches.ask.isEnabled()
    click(has.give)
    wait_until(lambda: second.attach.shared[0].has_control and has.isVisible())
    assert not watches.isVisible()
    wait_until(lambda: not first.protocol_panel.buttons["Pause"].isEnabled())
    assert pause.isEnabled() and not resume.isEnabled() and "control" not in pause.toolTip()
    click(pause)
    wait_until(lambda: second.engine_link.status.run.state == "paused", TIMEOUT_MS)
    click(has.take)
    wait_until(lambda: first.attach.shared[0].has_control)
    first.engine_link.request("resume")
    wait_until(lambda: first.engine_link.status.run.state == "running", TIMEOUT_MS)


def test_closing_a_window_during_a_run_asks(
    running: EngineClient, open_window: OpenWindow, tmp_path: Path
) -> None:
    window = joined(open_window())
    wait_until(lambda: window.engine_link.status.run.is_active, TIMEOUT_MS)
    strip = window.attach.closing
    assert not window.close() and strip.isVisible()
    assert "goes on without this window" in strip.text.text()
    click(strip.stay)
    assert window.isVisible() and not strip.isVisible()
    window.close()
    click(strip.leave)
    assert not window.isVisible()
    assert running.request("status")["run"]["state"] == "running"


def test_a_window_whose_engine_hangs_closes_at_once_and_says_what_is_left(
    running: EngineClient, open_window: OpenWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stayed on the screen for 10 s, and for 35 s where the engine was to end."""
    monkeypatch.setattr(client, "LEAVE_TIMEOUT_S", 0.3)
    window = joined(open_window())
    link = window.engine_link
    was_visible: list[bool] = []
    wait_closed = link.wait_closed
    monkeypatch.setattr(
        link, "wait_closed", lambda: (was_visible.append(window.isVisible()), wait_closed())
    )
    os.kill(running.engine_file.pid, signal.SIGSTOP)
    try:
        window.attach.leave()
    finally:
        os.kill(running.engine_file.pid, signal.SIGCONT)
    assert was_visible == [False] and not window.isVisible()
    (sentence,) = link.left_running
    assert f"(process {running.engine_file.pid}) does not answer and is left running" in sentence
    assert "the drum lifts by itself" in sentence
    assert running.request("status")["run"]["state"] == "running"
