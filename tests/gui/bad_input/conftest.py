"""A real engine on the virtual rig for the files that need one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication

from tests.gui.rig_window import RigWindow, rig_window


@pytest.fixture(scope="module")
def rig(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigWindow]:
    """Yield a small window on the virtual rig."""
    with rig_window(qapp, "virtual", tmp_path_factory.mktemp("virtual")) as opened:
        yield opened


@pytest.fixture(autouse=True)
def no_traceback(capfd: pytest.CaptureFixture[str]) -> Iterator[None]:
    """Demand after each test that nothing printed a traceback."""
    yield
    assert "Traceback" not in "".join(capfd.readouterr())
