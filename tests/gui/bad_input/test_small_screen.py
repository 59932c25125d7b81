"""A screen that is smaller than the window needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gui.app import screen_complaint

OPEN = """
import json
from PySide6.QtCore import QPoint, QTimer
from PySide6.QtWidgets import QApplication
from gui import app
from gui.shell.main_window import MainWindow

def look(window):
    stop = window.toolbar.stop_button
    corner = stop.mapTo(window, stop.rect().bottomRight())
    print(json.dumps([window.width(), window.height(), corner.x(), corner.y(),
                      window.event_log.toPlainText()]))
    window.close()

show = MainWindow.show
def show_and_look(window):
    show(window)
    QTimer.singleShot(0, lambda: look(window))
MainWindow.show = show_and_look
app.main([])
"""


def _opened_on(width: int, height: int, folder: Path) -> tuple[int, int, int, int, str]:
    """Open the program on a screen; return the window's size, STOP's last corner and the log."""
    screen = {"name": "small", "x": 0, "y": 0, "width": width, "height": height}
    config = folder / "screens.json"
    config.write_text(json.dumps({"screens": [screen]}))
    words = {"QT_QPA_PLATFORM": f"offscreen:configfile={config}", "XDG_CONFIG_HOME": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", OPEN],
        env=os.environ | words | {"XDG_RUNTIME_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "Traceback" not in done.stderr
    width_px, height_px, x, y, log = json.loads(done.stdout.splitlines()[-1])
    return width_px, height_px, x, y, log


def test_a_small_screen_is_named_with_its_cure(tmp_path: Path) -> None:
    width, height, x, y, log = _opened_on(800, 600, tmp_path)
    assert "the screen has 800 × 600 px, the window needs 1024 × 700" in log
    assert "View → Text size" in log
    assert x < width and y < height


def test_a_large_screen_is_not_mentioned(tmp_path: Path) -> None:
    width, height, *_, log = _opened_on(1024, 700, tmp_path)
    assert "px" not in log and (width, height) <= (1024, 700)


@pytest.mark.parametrize(
    ("size", "is_small"), [((1024, 700), False), ((1023, 700), True), ((1024, 699), True)]
)
def test_the_limit(size: tuple[int, int], is_small: bool) -> None:
    assert bool(screen_complaint(*size)) is is_small
