"""A state of the window that is worth a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gui.screenshots.camera import Camera
from gui.screenshots.recordings import Recordings
from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice

SAVE_IN = "~/rigctl-sessions"
"""What fields for folders show, on whatever computer."""


def always() -> bool:
    """Return that a scene that does not move is ready."""
    return True


@dataclass(frozen=True, slots=True)
class Scene:
    """A name, and when to take the picture. ``choice``: the only theme, None for both."""

    name: str
    ready: Callable[[], bool] = field(default=always)
    choice: ThemeChoice | None = None


@dataclass(frozen=True, slots=True)
class Studio:
    """The window, its camera, a folder to work in, and what is recorded there."""

    window: MainWindow
    camera: Camera
    work: Path
    recordings: Recordings
