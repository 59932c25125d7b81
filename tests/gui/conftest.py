"""Windows without a display, most of them with an engine that the test controls."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication, QGraphicsView
from shiboken6 import delete

from gui.analysis.worker import WORKER_THREAD
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from tests.gui.fake_engine import FakeEngine
from tests.gui.fake_finger import FakeFinger
from tests.gui.steps import FingerWindow, Harness, SharedWindow, wait_until


@pytest.fixture(autouse=True, scope="session")
def own_engines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the STOP of a test from the engines of the user who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(tmp_path_factory.mktemp("runtime")))
        yield


@pytest.fixture(autouse=True, scope="session")
def no_plot_outlives_qt(own_engines: None) -> Iterator[None]:
    """Delete the plots that tests made: left to Qt's end, they crash the process.

    Qt's end takes objects in any order, and a scene whose items have gone crashes. Python's
    collector leaves a plot that has a connection to a function of its own.
    """
    yield
    for plots in [w for w in QApplication.topLevelWidgets() if w.findChild(QGraphicsView)]:
        delete(plots)


@pytest.fixture(autouse=True)
def workers_rest() -> Iterator[None]:
    """Let worker processes finish what a test has asked of them: a thread waits for the answer."""
    yield
    wait_until(lambda: not any(t.name == WORKER_THREAD for t in threading.enumerate()), 120_000)


@pytest.fixture
def engine(tmp_path: Path) -> FakeEngine:
    """Return an engine that the test controls."""
    return FakeEngine(tmp_path)


@pytest.fixture(scope="session")
def shared(qapp: QApplication) -> Iterator[SharedWindow]:
    """Yield a window that connects to any engine; building a window takes a second."""
    shared = SharedWindow()
    shared.window.show()
    yield shared
    shared.window.close()
    delete(shared.window)


@pytest.fixture
def disconnected(shared: SharedWindow, engine: FakeEngine) -> Iterator[SharedWindow]:
    """Yield the shared window without a connection; the engine is there to connect to."""
    shared.engine, shared.error, shared.opened = engine, None, []
    shared.window.show_panel("operate")
    shared.window.event_log.clear()
    shared.window.run_end_strip.hide()  # of the run of another test
    yield shared
    shared.window.engine_link.close()
    shared.window.engine_link.wait_closed()


@pytest.fixture
def harness(disconnected: SharedWindow, engine: FakeEngine) -> Iterator[Harness]:
    """Yield the shared window, connected to the engine."""
    window = disconnected.window
    window.connect_rig("virtual")
    wait_until(lambda: window.engine_link.live is not None)
    yield Harness(window, engine)
    window.engine_link.close()
    window.engine_link.wait_closed()
    assert engine.is_closed


@pytest.fixture
def leave_nothing(harness: Harness) -> Iterator[None]:
    """Leave no session and no long sentence in the window that the tests share."""
    yield
    harness.window.analysis_tab.panel.show_unopened("No session is open.")
    harness.window.status_line.clear()


@pytest.fixture
def finger(shared: SharedWindow, tmp_path: Path) -> Iterator[FingerWindow]:
    """Yield the shared window on its tab Finger, connected to an engine of the moving finger."""
    shared.finger, shared.error, shared.finger_specs = FakeFinger(tmp_path), None, []
    window, tab = shared.window, shared.window.finger_tab
    window.show_panel("finger")
    window.event_log.clear()
    tab.setup.choose_stage("train")
    tab.setup.model.clear()
    tab.setup.out.setText(str(tmp_path))
    tab.connect_rig("virtual")
    wait_until(lambda: tab.link.live is not None)
    yield FingerWindow(window, shared.finger)
    tab.worker.cancel()
    tab.link.close()
    tab.link.wait_closed()
    tab.link.poll()
    window.show_panel("operate")
