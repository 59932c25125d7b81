"""``python -m tools.screenshots FOLDER``: render every page, and a film, from live virtual rigs.

All pictures go to FOLDER; those that the documentation shows go beside the ones that it has, too.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pyqtgraph as pg
from shiboken6 import delete

from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from tools.screenshots.camera import Camera
from tools.screenshots.film import film_session
from tools.screenshots.scenes import (
    Recordings,
    Scene,
    Studio,
    drum_scenes,
    finger_scenes,
    page_scenes,
    recorded_scenes,
)

FILM = "session.gif"
IMAGES = Path("docs/images")
_SHOWN = re.compile(r"images/([\w.-]+)")


def main(argv: list[str]) -> int:
    """Render all pictures into the folder; return the exit code."""
    if len(argv) != 1 or argv[0].startswith("-"):
        print("usage: python -m tools.screenshots FOLDER", file=sys.stderr)
        return 2
    folder = Path(argv[0])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        os.environ[FOLDER_VARIABLE] = work
        camera = render_all(folder, Path(work))
    names = publish(folder, Path())
    size_mb = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
    print(
        f"{camera.n_taken} pictures and a film in {folder}, {size_mb:.1f} MB, "
        f"in {camera.seconds:.0f} s; in {IMAGES}: {', '.join(names)}"
    )
    return 0


def render_all(folder: Path, work: Path) -> Camera:
    """Drive a window through all scenes, and return the camera that took them."""
    pg.mkQApp()
    window, recordings = MainWindow(choice=ThemeChoice.LIGHT), Recordings(work)
    studio = Studio(window, Camera(window, folder), work, recordings)
    try:
        window.show()
        film = film_session(studio)
        for scene in _scenes(studio):
            _take(studio, scene)
        film.write(folder / FILM)
        studio.camera.finish()
    finally:
        recordings.end()
        _leave(window)
        delete(window)
    return studio.camera


def publish(folder: Path, root: Path) -> list[str]:
    """Copy the pictures that a page of the documentation shows to its images; return their names.

    ``root``: the folder of the README and of ``docs``.
    """
    pages = [root / "README.md", *(root / "docs").rglob("*.md")]
    shown = {name for page in pages for name in _SHOWN.findall(page.read_text(encoding="utf-8"))}
    names = sorted(name for name in shown if (folder / name).exists())
    for name in names:
        shutil.copyfile(folder / name, root / IMAGES / name)
    return names


def _scenes(studio: Studio) -> Iterator[Scene]:
    """Return the scenes; recordings go on beside the first ones and not beside the finger's."""
    yield from chain(drum_scenes(studio), recorded_scenes(studio), page_scenes(studio))
    studio.window.engine_link.request("abort")
    yield from finger_scenes(studio)


def _take(studio: Studio, scene: Scene) -> None:
    studio.recordings.advance()
    if scene.choice is None:
        studio.camera.shoot(scene.name, scene.ready)
    else:
        studio.camera.shoot_theme(scene.name, scene.choice, scene.ready)


def _leave(window: MainWindow) -> None:
    for link in (window.engine_link, window.finger_tab.link):
        if link.is_connected:
            link.request("abort")
    window.attach.leave()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
