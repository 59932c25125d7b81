"""One window on the compiled firmware for each file of flows."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication

from tests.gui.rig_window import RigWindow, rig_window


@pytest.fixture(scope="module")
def rig(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigWindow]:
    """Yield a small window whose Connect has started the firmware on simulated chips."""
    with rig_window(qapp, "firmware", tmp_path_factory.mktemp("firmware")) as opened:
        yield opened


@pytest.fixture(autouse=True)
def no_traceback(rig: RigWindow, capfd: pytest.CaptureFixture[str]) -> Iterator[None]:
    """Demand after each flow that nothing ended in a traceback, in the log or beside it."""
    yield
    seen = rig.log + "".join(capfd.readouterr())
    assert "Traceback" not in seen
