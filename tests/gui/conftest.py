"""Windows without a display; Qt must be told before it is imported."""

from __future__ import annotations

import os

os.environ["QT_QPA_PLATFORM"] = "offscreen"

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication
from shiboken6 import delete

from rigctl.acquisition.rpc.engine_files import FOLDER_VARIABLE
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import Bench, Shown, wait_until


@pytest.fixture(autouse=True, scope="session")
def own_engines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A STOP in a test reaches no engine of whoever runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(tmp_path_factory.mktemp("runtime")))
        yield


@pytest.fixture(scope="session")
def app() -> QApplication:
    """The one application of this process."""
    found = QApplication.instance()
    return found if isinstance(found, QApplication) else QApplication([])


@pytest.fixture
def engine(tmp_path: Path) -> FakeEngine:
    """An engine that does what the test says."""
    return FakeEngine(tmp_path)


@pytest.fixture(scope="session")
def shown(app: QApplication) -> Iterator[Shown]:
    """A window that connects to whatever engine is put behind it; building one takes a second."""
    shown = Shown()
    shown.window.show()
    yield shown
    shown.window.close()
    delete(shown.window)


@pytest.fixture
def bench(shown: Shown, engine: FakeEngine) -> Iterator[Bench]:
    """A window as it was opened, connected to the engine."""
    window, shown.engine = shown.window, engine
    window.tabs.setCurrentIndex(0)
    window.event_log.clear()
    window.connect_rig("virtual")
    wait_until(lambda: window.engine_link.is_open)
    yield Bench(window, engine)
    window.engine_link.close()
    window.engine_link.wait_closed()
    assert engine.is_closed
