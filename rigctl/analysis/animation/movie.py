"""A movie: a figure and what sets each frame of it. Figures of simulated data are marked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.figures import MUTED, TEXT, show_dollars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
FRAME_S = 0.08
"""Time between frames: 12.5 a second. GIF counts in hundredths of a second."""
HOLD_S = 2.0
"""The last frame stands still for this time."""
SIMULATED = "#8a4600"

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Movie:
    """A figure on an Agg canvas, and its frames.

    ``set_frame``: sets what the next drawing shows; frames count from 0. ``rare_colours``: colours
    that the last frame may lack, for the palette of a GIF.
    """

    figure: Figure
    n_frames: int
    set_frame: Callable[[int], None]
    rare_colours: tuple[str, ...] = ()

    def draw(self, number: int) -> Pixels:
        """Draw a frame; return its pixels, uint8 (height, width, 3), valid until the next one."""
        self.set_frame(number)
        return draw_pixels(self.figure)


def new_movie_figure(size_in: tuple[float, float]) -> Figure:
    """Return a figure of that size in inches on an Agg canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def draw_pixels(figure: Figure) -> Pixels:
    """Draw a figure as it is; return its pixels, uint8 (height, width, 3)."""
    show_dollars(figure)
    canvas: Any = figure.canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3]


def write_head(figure: Figure, title: str, words: str, foot: str, simulated: bool) -> None:
    """Write the title, words below it and the foot; mark a figure of simulated data."""
    figure.text(0.012, 0.957, title, size=14, color=TEXT, weight="bold")
    figure.text(0.012, 0.926, words, size=9.5, color=MUTED)
    figure.text(0.012, 0.012, foot, size=8, color=MUTED)
    if simulated:
        box = {"boxstyle": "round,pad=0.35", "fc": "#fff3e0", "ec": SIMULATED, "lw": 0.8}
        figure.text(0.64, 0.947, "SIMULATED", size=10, color=SIMULATED, weight="bold", bbox=box)


def write_clock(figure: Figure) -> Any:
    """Write an empty clock at the upper right; return its text."""
    return figure.text(0.99, 0.94, "", ha="right", size=19, color=TEXT, weight="bold")
