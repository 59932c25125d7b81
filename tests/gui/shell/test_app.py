"""Start of the window without a display."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

WITHOUT_LIBRARY = """
import sys
from rigctl.cli import main
sys.modules["PySide6.QtGui"] = None
raise SystemExit(main(["gui"]))
"""
DISPLAYS = {"DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"}


def refusal(*options: str, **display: str) -> str:
    """Return the one sentence with which the window does not open."""
    environment = {name: value for name, value in os.environ.items() if name not in DISPLAYS}
    done = subprocess.run(
        [sys.executable, *options],
        capture_output=True,
        text=True,
        check=False,
        env={**environment, **display},
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    return done.stderr


def test_missing_display_is_one_sentence() -> None:
    assert "needs a display" in refusal("-m", "rigctl", "gui")


def test_missing_libraries_are_named() -> None:
    said = refusal("-m", "rigctl", "gui", QT_QPA_PLATFORM="nonsense")
    assert "libxcb-cursor0" in said and '"nonsense"' in said


@contextmanager
def free_display() -> Iterator[str]:
    """Yield a display that no server has: its socket is bound here, and nobody listens."""
    with socket.socket(socket.AF_UNIX) as held:
        for number in count(77):
            path = f"/tmp/.X11-unix/X{number}"
            with suppress(OSError):  # a server has it
                if not Path(path).exists():
                    held.bind(f"\0{path}")
                    break
        yield f":{number}"


def test_a_display_that_does_not_answer_is_named() -> None:
    with free_display() as display:
        said = refusal("-m", "rigctl", "gui", DISPLAY=display)
    assert f"could not connect to display {display}" in said


def test_qt_that_cannot_be_loaded_is_named() -> None:
    said = refusal("-c", WITHOUT_LIBRARY, QT_QPA_PLATFORM="offscreen")
    assert "PySide6.QtGui" in said and "libegl1" in said
