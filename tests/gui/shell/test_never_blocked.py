"""Neither a slow disk, board, engine nor analysis makes the window wait."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication, QPushButton

from gui.analysis.results import AnalysisResults, plot_page
from gui.analysis.task_values import SessionTable, TrialData
from gui.analysis.worker import Worker
from gui.link.engine_link import STOP_TIMED_OUT
from gui.shell.start_page import CANCELLED
from rigctl.boards.drum_states import State
from rigctl.engine.rpc.engine_files import running_engines, runtime_folder
from rigctl.session.sensor_layout import SensorLayout
from rigctl.synth.sample_session import MAKING
from tests.analysis.recordings import record
from tests.gui.fake_engine import FakeEngine
from tests.gui.made_trials import made_trial
from tests.gui.rig_window import RigWindow, rig_window
from tests.gui.steps import Harness, SharedWindow, click, press_escape
from tests.gui.texts.results_scenes import ORIGIN, largest_accuracy, largest_confusion
from tests.gui.watchdog.qt_thread import QtThreadWatchdog
from tests.gui.watchdog.slow_disk import slow_disk

SLOW_S = 0.4
BOARDS = ("drum", "taxels")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session with four textures."""
    return record(tmp_path_factory.mktemp("recorded") / "session", repeats=1)


@pytest.fixture
def watchdog() -> Iterator[QtThreadWatchdog]:
    """Yield a watchdog that must have found nothing at the end."""
    with QtThreadWatchdog() as watchdog:
        yield watchdog
    assert [str(call) for call in (*watchdog.blocked, *watchdog.busy)] == []


class SlowEngine(FakeEngine):
    """An engine that never replies and takes its time to end."""

    replies = False

    def shut_down(self, timeout_s: float = 30.0) -> int | None:
        """End slowly, as an engine that lifts the drum."""
        time.sleep(SLOW_S)
        return super().shut_down()


def test_an_engine_that_opens_ends_and_answers_slowly(
    disconnected: SharedWindow, tmp_path: Path, watchdog: QtThreadWatchdog
) -> None:
    window = disconnected.window
    (tmp_path / "slow").mkdir()
    engine = disconnected.engine = SlowEngine(tmp_path / "slow")
    engine.replies = False
    watchdog.run(lambda: window.connect_rig("virtual"))
    watchdog.run_until(lambda: window.engine_link.live is not None)
    engine.send_status(state=int(State.ARMED))
    watchdog.run_until(window.operate_panel.buttons["home"].isEnabled)
    for name in ("home", "tare", "disarm"):
        watchdog.run(lambda name=name: click(window.operate_panel.buttons[name]))
    watchdog.run(lambda: press_escape(window))
    watchdog.run(window.engine_link.close)
    watchdog.run_until(lambda: engine.is_closed)
    assert engine.commands[:3] == ["home", "tare", "disarm"]


def test_a_slow_disk(
    harness: Harness, session: Path, tmp_path: Path, watchdog: QtThreadWatchdog
) -> None:
    window = harness.window
    protocol, analysis = window.protocol_panel, window.analysis_tab
    with slow_disk(str(tmp_path.parent)), slow_disk(str(session.parent)):
        for panel in ("operate", "protocol", "analysis", "finger"):
            watchdog.run(lambda panel=panel: window.show_panel(panel))
        watchdog.run(lambda: protocol.out.setText(str(tmp_path)))
        watchdog.run(lambda: protocol.add_protocol(str(tmp_path / "none.toml")))
        watchdog.run_until(lambda: bool(protocol.problem.text()))
        watchdog.run(lambda: protocol.protocol.setCurrentIndex(0))
        watchdog.run_until(lambda: not protocol.problem.text() and not protocol.worker.is_busy)
        window.show_panel("analysis")
        analysis.panel.folder.setText(str(session))
        watchdog.run(lambda: click(analysis.panel.open_button))
        watchdog.run_until(lambda: analysis.trial_view.data is not None)
        watchdog.run(lambda: analysis.panel.table.selectRow(7))
        watchdog.run_until(lambda: not analysis.worker.is_busy)
        sample = window.start.sample_box
        watchdog.run(window.start.show)
        watchdog.run(lambda: click(window.start.sample))
        watchdog.run_until(lambda: sample.text.text().startswith(MAKING))
        watchdog.run(lambda: click(sample.cancel_button))
        watchdog.run_until(lambda: sample.text.text() == CANCELLED)
        watchdog.run(lambda: click(window.start.back))


def test_an_analysis_that_is_slow_and_is_cancelled(
    harness: Harness, session: Path, watchdog: QtThreadWatchdog
) -> None:
    window = harness.window
    window.show_panel("analysis")
    analysis, box = window.analysis_tab, window.analysis_tab.panel.run_box
    analysis.panel.folder.setText(str(session))
    watchdog.run(lambda: click(analysis.panel.open_button))
    watchdog.run_until(lambda: not analysis.worker.is_busy)
    watchdog.run(lambda: box.method.setCurrentIndex(0))
    watchdog.run(lambda: click(box.run_button))
    watchdog.run_until(box.cancel_button.isEnabled)
    watchdog.run(lambda: click(box.cancel_button))
    watchdog.run_until(box.run_button.isEnabled)


def test_an_analysis_is_slow_while_samples_scroll(
    harness: Harness, session: Path, watchdog: QtThreadWatchdog
) -> None:
    window, engine, tab = harness.window, harness.engine, harness.window.analysis_tab
    window.show_panel("analysis")
    tab.panel.folder.setText(str(session))
    watchdog.run(lambda: click(tab.panel.open_button))
    watchdog.run_until(lambda: not tab.reader.is_busy)
    box = tab.panel.run_box
    watchdog.run(lambda: box.method.setCurrentIndex(1))
    watchdog.run(lambda: click(box.run_button))
    watchdog.run(lambda: window.show_panel("operate"))
    before = len(window.live_plots.data.history)
    while tab.worker.is_busy and len(window.live_plots.data.history) < before + 5_000:
        engine.write_samples(100)
        watchdog.run(window.poll)
    assert len(window.live_plots.data.history) > before
    watchdog.run(lambda: click(box.cancel_button))
    watchdog.run_until(lambda: not tab.worker.is_busy)
    watchdog.run(lambda: box.method.setCurrentIndex(0))


def test_a_large_text_is_sent_to_a_process_that_works_or_has_ended(
    qapp: QApplication, tmp_path: Path, watchdog: QtThreadWatchdog
) -> None:
    worker, ends = Worker(), []
    worker.finished.connect(lambda task, result: ends.append(str(result)))
    worker.failed.connect(lambda task, sentence: ends.append(sentence))
    path, text = tmp_path / "large.toml", "# a line\n" * (1 << 17)
    large = {"path": str(path), "text": text, "may_replace": True}

    def wait_ends(count: int) -> None:
        watchdog.run_until(lambda: len(ends) == count)

    worker.submit("save_protocol", **large)
    wait_ends(1)
    assert worker._process is not None
    process, pid = worker._process, worker._process.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    watchdog.run(lambda: worker.submit("save_protocol", **large))
    assert worker.is_busy
    os.kill(pid, signal.SIGCONT)
    wait_ends(2)
    assert path.read_text() == text
    process.kill()
    process.join()
    worker.submit("prepare")
    wait_ends(3)
    assert "ended unexpectedly: try again" in ends[2]
    worker.submit("save_protocol", **large)
    wait_ends(4)
    assert worker._process.pid is not None
    os.kill(worker._process.pid, signal.SIGSTOP)  # as one that a slow share holds
    worker.submit("save_protocol", **large)
    watchdog.run(worker.cancel)
    assert ends[3] == str(path)


def test_large_pages_are_saved_while_the_window_answers(
    harness: Harness, tmp_path: Path, watchdog: QtThreadWatchdog
) -> None:
    """The compression of a PNG or PDF took a tenth of a second and more of the Qt thread."""
    window, tab = harness.window, harness.window.analysis_tab
    before = window.size()
    window.resize(1920, 1080)
    window.show_panel("analysis")
    tab.panel.verify_requested.emit(str(tmp_path / "session"), "")  # sets where pages are saved
    watchdog.run_until(lambda: not tab.worker.is_busy)
    pages = (
        plot_page("Accuracy", ORIGIN, largest_accuracy()),
        plot_page("Confusion", ORIGIN, *largest_confusion()),
    )
    tab.results_panel.show_results(AnalysisResults("done", pages, name="large"), "")
    tab._show(tab.results_panel)
    for index, page in enumerate(("accuracy", "confusion")):
        tab.results_view.setCurrentIndex(index)
        watchdog.run_until(lambda: tab.results_view.is_whole)
        for suffix in ("png", "svg", "pdf"):
            file = tmp_path / "session-figures" / f"large-{page}.{suffix}"
            watchdog.run(window.save_menu.actions[suffix].trigger)
            watchdog.run_until(file.exists)
    tab.trial_view.show_trial(long_trial())
    tab.panel.sessions = {str(tmp_path / "session"): SessionTable()}
    tab._show(tab.trial_view)
    for suffix in ("png", "pdf", "csv"):
        watchdog.run(window.save_menu.actions[suffix].trigger)
        file = tmp_path / "session-figures" / f"trial-1-readings.{suffix}"
        watchdog.run_until(file.exists)
    tab.panel.show_unopened("No session is open.")
    tab.trial_view.show_trial(None)
    window.resize(before)


def long_trial() -> TrialData:
    """Return a trial of six seconds."""
    rng, n = np.random.default_rng(0), 6000
    samples = rng.integers(0, 1023, (n, 18)).astype(np.uint16)
    rows, at = rng.integers(0, 36, 18_000), rng.integers(0, n, 18_000)
    return made_trial(samples, rows, at, SensorLayout.default(18))


def test_a_board_that_answers_slowly(
    harness: Harness, monkeypatch: pytest.MonkeyPatch, watchdog: QtThreadWatchdog
) -> None:
    """Polls grow old, and commands have no answer, while samples and statuses go on to come."""
    window, engine = harness.window, harness.engine
    window.show_panel("operate")
    monkeypatch.setattr(engine, "replies", False)
    engine.send_status(state=int(State.ARMED))
    watchdog.run_until(window.operate_panel.buttons["home"].isEnabled)
    for name in ("home", "tare"):
        watchdog.run(lambda name=name: click(window.operate_panel.buttons[name]))
    for tenths in range(30):
        engine.write_samples(100)
        engine.send_status(state=int(State.ARMED), poll_age_s=tenths / 10, poll_retries=tenths)
        watchdog.run(window.poll)
    watchdog.run(lambda: press_escape(window))
    watchdog.run_until(lambda: engine.commands[-1] == "stop")


@contextmanager
def served_boards(folder: Path) -> Iterator[tuple[Path, int]]:
    """Yield the rig file of simulated boards behind real ports, and the process that is them."""
    command = [sys.executable, "-m", "rigctl", "serve", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        served = json.loads(process.stdout.readline())
        ports = "".join(f'{board} = "tcp://{served[board]["tcp"]}"\n' for board in BOARDS)
        (folder / "rig.toml").write_text(f"[ports]\n{ports}")
        try:
            yield folder / "rig.toml", process.pid
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)


def _arm(rig: RigWindow) -> None:
    """Arm the drum, again where a busy computer let the boards stall before their time."""
    window = rig.window
    buttons = [window.operate_panel.buttons[name] for name in ("clear_fault", "arm")]
    while rig.status.state is not State.ARMED:
        for button in filter(QPushButton.isEnabled, buttons):
            click(button)
        rig.until(lambda: not window.engine_link.is_waiting)
        rig.until(lambda: rig.status.state is State.ARMED or any(b.isEnabled() for b in buttons))


def test_boards_that_stall_on_their_ports(
    qapp: QApplication, tmp_path: Path, watchdog: QtThreadWatchdog
) -> None:
    """Both boards stop again and again; the drum calls it a fault, and at last the link is lost."""
    with served_boards(tmp_path) as (file, boards), rig_window(qapp, str(file), tmp_path) as rig:
        window, link = rig.window, rig.window.engine_link
        _arm(rig)
        for _ in range(3):
            os.kill(boards, signal.SIGSTOP)
            watchdog.run_until(lambda: link.status.poll_age_s > SLOW_S)
            os.kill(boards, signal.SIGCONT)
            watchdog.run_until(lambda: link.status.poll_age_s < SLOW_S)
        watchdog.run_until(window.operate_panel.buttons["clear_fault"].isEnabled)
        os.kill(boards, signal.SIGSTOP)
        watchdog.run(lambda: click(window.operate_panel.buttons["clear_fault"]))
        watchdog.run(lambda: press_escape(window))
        watchdog.run_until(lambda: not link.status.drum_connected)
        watchdog.run_until(lambda: not link.status.taxels_connected)
        os.kill(boards, signal.SIGCONT)
        watchdog.run_until(lambda: link.status.drum_connected and link.status.taxels_connected)


def test_an_engine_that_is_suspended_while_the_window_floods_it(
    qapp: QApplication, tmp_path: Path, watchdog: QtThreadWatchdog
) -> None:
    """A full socket held the window for ten seconds; STOP arrives once the engine goes on."""
    with rig_window(qapp, "virtual", tmp_path) as rig:
        rig.press("arm")
        rig.until(lambda: rig.status.state is not State.IDLE)
        link, window = rig.window.engine_link, rig.window
        answers: list[str] = []
        link.refused.connect(lambda command, error: answers.append(error))
        link.interrupted.connect(lambda command: answers.append("ended by STOP"))
        (engine,) = running_engines(runtime_folder())
        os.kill(engine.pid, signal.SIGSTOP)
        try:
            while not any("has not read" in error for error in answers):
                for _ in range(20):
                    watchdog.run(lambda: link.request("note", text="x" * 1000))
            watchdog.run(lambda: press_escape(window))
            watchdog.run_until(lambda: STOP_TIMED_OUT in rig.log)
            assert answers.count("ended by STOP") > 60
        finally:
            os.kill(engine.pid, signal.SIGCONT)
        late = f"STOP reached virtual (process {engine.pid}), "
        watchdog.run_until(lambda: late in rig.log)
        assert "a stop preempted" not in rig.log
