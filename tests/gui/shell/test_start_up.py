"""The window opens without the modules that it does not show."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QGraphicsView

from gui.shell.main_window import MainWindow
from tests.gui.steps import own_window

LOADED = """
import sys
import gui.shell.main_window
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
LEFT_AT_ONCE = """
import sys
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication, QMenu
from gui import app
begin, (out, wait_ms) = app._begin, sys.argv[1:]

def begin_slow_work(window, args):
    begin(window, args)
    window.live_page.save_strip.folder.setText(out)
    window.live_page.save_picture()
    window.analysis_tab.files.save(out, "text", "csv", b"1,2")
    window.analysis_tab.open_session(out)
    window.replay.show()
    window.replay.page.open(out, 0)
    window.start.maker.start()
    window.tools.setup_page.boards.worker.find()
    window.attach.list_engines()
    window.protocol_panel.add_protocol(out)
    QTimer.singleShot(int(wait_ms), window.close)

app._begin = begin_slow_work
code = app.main([])
print(code, [left for left in QApplication.allWidgets() if not isinstance(left, QMenu)])
"""
"""Menus that are left are those of pyqtgraph's plots, which nobody opens."""
OFFSCREEN = "This plugin does not support propagateSizeHints()"
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
    """The first replay and the first saved picture kept the window, and STOP with it.

    What is not in view at the start is made behind the first picture of the window.
    """
    with own_window() as window:
        window.show()
        qapp.processEvents()
        assert not window.replay.is_made and _waiting(window)
        assert "analysis_tab" not in vars(window)
        window.prepare()
        assert window.replay.is_made and not window.replay.is_shown and not _waiting(window)
        assert window.stack.currentWidget() is window.live_page


@pytest.mark.parametrize("wait_ms", [0, 30, 300, 1500])
def test_a_window_that_is_left_amid_slow_work_ends_as_any_other(
    tmp_path: Path, wait_ms: int
) -> None:
    """A thread that tells a window which has gone, or a widget that is left, crashes the end."""
    command = [sys.executable, "-X", "faulthandler", "-c", LEFT_AT_ONCE, str(tmp_path)]
    done = subprocess.run([*command, str(wait_ms)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0 []\n", done.stderr)
    assert set(done.stderr.splitlines()) <= {OFFSCREEN}
    assert len(list(tmp_path.iterdir())) == 2  # what was being saved is whole


def _waiting(window: MainWindow) -> list[QGraphicsView]:
    """Return the plots that Qt has yet to tell their size."""
    pending = Qt.WidgetAttribute.WA_PendingResizeEvent
    return [view for view in window.findChildren(QGraphicsView) if view.testAttribute(pending)]
