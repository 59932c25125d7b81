"""A short film of a session: connect, approach, run, spikes, stop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PIL import Image
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor, QPainter, QPen
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton

from gui.widgets.theme import ThemeChoice
from rigctl.boards.drum_states import State
from tools.screenshots.camera import pixels
from tools.screenshots.scenes import SAVE_IN, Studio

SIZE = (1024, 700)
FRAME_MS = 125
MAX_FRAMES = 300  # of one action
WAIT_FRAMES = 16  # of the wait for an engine, which nobody wants to watch
MAX_BYTES = 3_000_000
COLOURS = 256
RING_PX, RING_FRAMES = 22, 2
RING = QColor("#ff9800")
LAST_FRAME_MS = 1250


class Film:
    """Frames of the window; a click on a button is seen as a ring."""

    def __init__(self, studio: Studio) -> None:
        self._studio, self._window = studio, studio.window
        self.frames: list[Image.Image] = []

    def roll(self, n_frames: int, at: QPoint | None = None) -> None:
        """Take some frames, with a ring at a place of the window."""
        for _ in range(n_frames):
            QTest.qWait(FRAME_MS)
            picture = self._window.grab()
            if at is not None:
                painter = QPainter(picture)
                painter.setRenderHint(QPainter.RenderHint.Antialiasing)
                painter.setPen(QPen(RING, 4))
                painter.drawEllipse(at, RING_PX, RING_PX)
                painter.end()
            self.frames.append(pixels(picture.toImage()))

    def roll_until(self, done: Callable[[], bool], most: int = MAX_FRAMES) -> None:
        """Take frames until a condition is true, but not more than ``most`` of a long wait."""
        n = 0
        while not done():
            if n < most:
                self.roll(1)
            else:
                QTest.qWait(FRAME_MS)
            n += 1
            if n > MAX_FRAMES:
                raise SystemExit(
                    f"the film came to no end:\n{self._window.event_log.toPlainText()}"
                )

    def click(self, button: QPushButton) -> None:
        """Wait for a button and click it, with a ring around the place."""
        self.roll_until(button.isEnabled)
        self.roll(RING_FRAMES, button.mapTo(self._window, button.rect().center()))
        QTest.mouseClick(button, Qt.MouseButton.LeftButton)

    def write(self, path: Path) -> None:
        """Write a GIF that stays below the limit, with fewer frames if it must."""
        for every in range(1, 8):
            frames, still_ms = self.frames[::every], FRAME_MS * every
            palette = _palette(frames)
            dither = Image.Dither.NONE
            shown = [frame.quantize(palette=palette, dither=dither) for frame in frames]
            times = [still_ms] * (len(shown) - 1) + [LAST_FRAME_MS]
            shown[0].save(
                path, "GIF", save_all=True, append_images=shown[1:], duration=times, loop=0
            )
            if path.stat().st_size < MAX_BYTES:
                return


def film_session(studio: Studio) -> Film:
    """Connect, bring up, approach, run and stop by hand; leave the drum armed."""
    window, film = studio.window, Film(studio)
    window.operate_panel.record_box.folder.setText(SAVE_IN)
    window.set_theme(ThemeChoice.DARK)
    window.resize(*SIZE)
    link, buttons = window.engine_link, window.operate_panel.buttons
    film.roll(3)
    film.click(window.toolbar.connect_button)
    film.roll_until(
        lambda: link.status.drum_connected and link.status.taxels_connected, WAIT_FRAMES
    )
    film.click(buttons["arm"])
    film.roll_until(lambda: link.status.state is State.ARMED)
    film.click(buttons["tare"])
    film.click(buttons["approach"])
    film.roll_until(lambda: link.status.state is State.HOLD, 2 * WAIT_FRAMES)
    film.click(buttons["run"])
    film.roll_until(lambda: link.status.speed_mm_s > 0.9 * link.status.speed_set_mm_s > 0)
    film.roll(24)
    film.click(window.toolbar.stop_button)
    film.roll_until(lambda: link.status.state is State.ARMED)
    film.roll(8)
    return film


def _palette(frames: list[Image.Image]) -> Image.Image:
    """Return one palette for all frames, from some that have all the colours together."""
    chosen = [*frames[:: max(1, len(frames) // 6)], frames[-1]]
    width, height = chosen[0].size
    sheet = Image.new("RGB", (width, height * len(chosen)))
    for row, frame in enumerate(chosen):
        sheet.paste(frame, (0, row * height))
    return sheet.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
