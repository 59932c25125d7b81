"""The window opens without the modules that it does not show."""

from __future__ import annotations

import subprocess
import sys

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QGraphicsView
from shiboken6 import delete

from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice

LOADED = """
import sys
import gui.shell.main_window
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
HEAVY = {"dask", "h5py", "matplotlib", "numba", "pandas", "scipy", "sklearn"}


def test_the_window_loads_no_compiler_and_no_statistics() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert "pyqtgraph" in loaded
    assert not HEAVY & loaded


def test_pages_that_are_not_in_view_are_made_and_laid_out_before_a_rig_moves(
    qapp: QApplication,
) -> None:
    """The first replay and the first saved picture kept the window, and STOP with it."""
    window = MainWindow(choice=ThemeChoice.LIGHT)
    window.show()
    qapp.processEvents()
    assert not window.replay.is_made and _waiting(window)
    window.prepare()
    assert window.replay.is_made and not window.replay.is_shown and not _waiting(window)
    assert window.stack.currentWidget() is window.live_page
    window.close()
    delete(window)


def _waiting(window: MainWindow) -> list[QGraphicsView]:
    """Return the plots that Qt has yet to tell their size."""
    pending = Qt.WidgetAttribute.WA_PendingResizeEvent
    return [view for view in window.findChildren(QGraphicsView) if view.testAttribute(pending)]
