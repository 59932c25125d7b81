"""Grabs the window in every theme and size, as PNG files of few colours."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from PIL import Image
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest

from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice

THEMES = (ThemeChoice.LIGHT, ThemeChoice.DARK)
SIZES = ((1024, 700), (1280, 800), (1920, 1080))
TIMEOUT_S = 300.0
SETTLING_MS = 250  # until layouts and traces have the new width
LAYOUT_MS = 50  # until what came last, such as a result of a worker, has its place
COLOURS = 256


class Camera:
    """Takes pictures of a window into a folder, and says how far it is."""

    def __init__(self, window: MainWindow, folder: Path) -> None:
        self.window, self.folder = window, folder
        self.n_taken = 0
        self._writers = ThreadPoolExecutor()
        self._writes: list[Future[None]] = []
        self._began_s = time.monotonic()

    @property
    def seconds(self) -> float:
        """Time since the camera was made."""
        return time.monotonic() - self._began_s

    def wait(self, done: Callable[[], bool]) -> None:
        """Let the window run until a condition is true. Raises SystemExit with the log if never."""
        end_s = time.monotonic() + TIMEOUT_S
        while not done():
            if time.monotonic() > end_s:
                log = self.window.event_log.toPlainText()
                raise SystemExit(f"the window did not reach the expected state:\n{log}")
            QTest.qWait(20)

    def shoot(self, name: str, ready: Callable[[], bool]) -> None:
        """Take a scene in every theme and size, each time when ``ready`` is true."""
        for choice in THEMES:
            self.shoot_theme(name, choice, ready)
        print(f"{self.seconds:5.0f} s  {name}", flush=True)

    def shoot_theme(self, name: str, choice: ThemeChoice, ready: Callable[[], bool]) -> None:
        """Take a scene in every size of one theme."""
        self.window.set_theme(choice)
        for width, height in SIZES:
            self.window.resize(width, height)
            QTest.qWait(SETTLING_MS)
            self.wait(ready)
            QTest.qWait(LAYOUT_MS)
            path = self.folder / f"{name}-{choice.name.lower()}-{width}x{height}.png"
            picture = pixels(self.window.grab().toImage())
            self._writes.append(self._writers.submit(_write, picture, path))
            self.n_taken += 1

    def finish(self) -> None:
        """Wait until all pictures are written. Raises OSError for one that is not."""
        for write in self._writes:
            write.result()
        self._writers.shutdown()


def pixels(image: QImage) -> Image.Image:
    """Return the pixels of a Qt image."""
    rgb = image.convertToFormat(QImage.Format.Format_RGB888)
    size, stride = (rgb.width(), rgb.height()), rgb.bytesPerLine()
    return Image.frombytes("RGB", size, bytes(rgb.constBits()), "raw", "RGB", stride, 1)


def few_colours(image: Image.Image) -> Image.Image:
    """Return an image with a palette: all of its colours, or those that come near them."""
    method, dither = Image.Quantize.FASTOCTREE, Image.Dither.NONE
    return image.quantize(COLOURS, method=method, dither=dither)


def _write(picture: Image.Image, path: Path) -> None:
    few_colours(picture).save(path, "PNG", optimize=True)
