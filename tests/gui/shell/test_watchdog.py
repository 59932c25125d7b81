"""The watchdog of the Qt thread finds a wait of any kind, and names the call that waited."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from tests.gui.watchdog.qt_thread import QtThreadWatchdog
from tests.gui.watchdog.slow_disk import slow_disk

LONG_S = 0.5


def _wait_for_a_lock() -> None:
    threading.Event().wait(LONG_S)


def _wait_for_a_socket() -> None:
    near, far = socket.socketpair()
    with near, far:
        near.settimeout(LONG_S)
        with pytest.raises(TimeoutError):
            near.recv(1)


def _wait_for_a_process() -> None:
    subprocess.run([sys.executable, "-c", f"import time; time.sleep({LONG_S})"], check=True)


def _work() -> None:
    sum(number**2 for number in range(4_000_000))


@pytest.mark.parametrize("wait", [_wait_for_a_lock, _wait_for_a_socket, _wait_for_a_process])
def test_a_wait_in_the_qt_thread_is_found_and_named(qapp: QApplication, wait: object) -> None:
    assert callable(wait)
    with QtThreadWatchdog() as watchdog:
        watchdog.run(wait)
    assert [call.slept_ms > 100 for call in watchdog.blocked] == [True]
    assert wait.__name__ in str(watchdog.blocked[0])


def test_the_slow_disk_is_slow_for_the_qt_thread(qapp: QApplication, tmp_path: Path) -> None:
    with slow_disk(str(tmp_path)), QtThreadWatchdog() as watchdog:
        watchdog.run((tmp_path / "file").exists)
        watchdog.run(lambda: (tmp_path / "file").write_text("text"))
        watchdog.run(Path(__file__).read_bytes)
    assert len(watchdog.blocked) == 2


def test_work_is_no_wait_and_is_named(qapp: QApplication) -> None:
    with QtThreadWatchdog() as watchdog:
        watchdog.run(_work)
    assert watchdog.blocked == []
    assert ["_work" in str(call) for call in watchdog.busy] == [True]


def test_waits_of_other_threads_and_idle_time_are_none(qapp: QApplication) -> None:
    thread = threading.Thread(target=_wait_for_a_lock)
    with QtThreadWatchdog() as watchdog:
        thread.start()
        watchdog.run_until(lambda: not thread.is_alive())
    assert watchdog.samples > 3 and watchdog.blocked == []
