"""Movies of any figure: GIF, MP4, or the last frame as PNG. The file is complete or absent."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.files import atomic_file
from rigctl.analysis.report.figures import MUTED, TEXT, show_dollars
from rigctl.errors import DiskFault, WrongUse

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

DPI = 100
FRAME_S = 0.08
"""Time between frames: 12.5 a second. GIF counts in hundredths of a second."""
HOLD_S = 2.0
"""The last frame stands still for this time."""
SIMULATED = "#8a4600"
Pixels = NDArray[np.uint8]
COLOURS = 256
"""Colours of a GIF, at most."""
FRAMES_STAGE = "drawing frames"
Progress = Callable[[str, int, int], None]


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


def check_movie_file(out: Path) -> None:
    """Raise WrongUse for a name that cannot become a movie, or whose file exists."""
    if out.suffix not in _WRITERS:
        raise WrongUse(f"{out} is none of {', '.join(_WRITERS)}: give the file one of these ends")
    if out.exists():
        raise WrongUse(f"{out} already exists: name another file, or remove it")
    if out.suffix == ".mp4":
        _check_ffmpeg()


def write_movie_file(make: Callable[[], Movie], out: Path, progress: Progress) -> None:
    """Write the movie that ``make`` returns, or for ``.png`` its last frame.

    ``progress``: called with the stage, frames done and frames in all. Raises WrongUse as
    :func:`check_movie_file` does, DiskFault where the file cannot be written.
    """
    check_movie_file(out)
    with atomic_file(out) as partial:
        _WRITERS[out.suffix](make(), partial, progress)


def _write_png(movie: Movie, partial: Path, progress: Progress) -> None:
    from PIL import Image

    progress(FRAMES_STAGE, 0, 1)
    last = movie.draw(movie.n_frames - 1)
    Image.fromarray(last).save(partial, "PNG", optimize=True)
    progress(FRAMES_STAGE, 1, 1)


def _write_gif(movie: Movie, partial: Path, progress: Progress) -> None:
    palette = _palette(movie)
    frames = (_quantised(movie.draw(number), palette) for number in _frames(movie, progress))
    frame_ms = round(1000 * FRAME_S)
    durations = [frame_ms] * (movie.n_frames - 1) + [round(1000 * HOLD_S)]
    # Pillow leaves a file that it opened itself open when it is interrupted.
    with partial.open("wb") as file:
        next(frames).save(
            file, "GIF", save_all=True, append_images=frames, duration=durations, loop=0
        )


def _write_mp4(movie: Movie, partial: Path, progress: Progress) -> None:
    from matplotlib.animation import FFMpegWriter

    # The name of a partial file does not tell ffmpeg its kind.
    options = ["-f", "mp4", "-pix_fmt", "yuv420p"]
    options += ["-vf", f"tpad=stop_mode=clone:stop_duration={HOLD_S:g}"]
    rate_hz: Any = 1 / FRAME_S  # matplotlib's types demand a whole number, ffmpeg does not
    writer = FFMpegWriter(fps=rate_hz, codec="h264", extra_args=options)
    try:
        with writer.saving(movie.figure, str(partial), DPI):
            for number in _frames(movie, progress):
                movie.set_frame(number)
                writer.grab_frame()
    except subprocess.CalledProcessError as error:
        raise DiskFault(f"ffmpeg could not write the movie ({error}): write a .gif") from error


_WRITERS = {".gif": _write_gif, ".mp4": _write_mp4, ".png": _write_png}


def _frames(movie: Movie, progress: Progress) -> Iterator[int]:
    for number in range(movie.n_frames):
        progress(FRAMES_STAGE, number, movie.n_frames)
        yield number
    progress(FRAMES_STAGE, movie.n_frames, movie.n_frames)


def _palette(movie: Movie) -> Image:
    """Return an image with the colours of all frames: the last one and the movie's rare colours.

    One palette for all keeps what stands still equal from frame to frame, and the file small.
    """
    from PIL import Image, ImageColor

    last = movie.draw(movie.n_frames - 1)
    shades = np.linspace(0.0, 1.0, last.shape[1])[None, :, None]
    strips = [
        np.tile(255 * (1 - shades) + shades * np.array(ImageColor.getrgb(name)), (12, 1, 1))
        for name in movie.rare_colours
    ]
    sample = np.concatenate([last, *strips]).astype(np.uint8)
    return Image.fromarray(sample).quantize(COLOURS, dither=Image.Dither.NONE)


def _quantised(pixels: Pixels, palette: Image) -> Image:
    from PIL import Image

    return Image.fromarray(pixels).quantize(palette=palette, dither=Image.Dither.NONE)


def _check_ffmpeg() -> None:
    """Raise WrongUse where ffmpeg is not installed."""
    from matplotlib.animation import FFMpegWriter

    if not FFMpegWriter.isAvailable():
        raise WrongUse("an .mp4 needs ffmpeg, which is not installed: install it or write a .gif")
