"""The movie of one taxel, as the paper's Movie S2: its signals grow while the texture passes."""

from __future__ import annotations

from functools import partial
from math import ceil
from pathlib import Path

from rigctl.analysis.animation.movie import (
    FRAME_S,
    Movie,
    new_movie_figure,
    write_clock,
    write_head,
)
from rigctl.analysis.animation.movie_file import Progress, write_movie_file
from rigctl.analysis.report.figures import STYLE
from rigctl.analysis.taxel.taxel_course import TaxelCourse
from rigctl.analysis.taxel.taxel_panels import HEIGHTS_OF_2D, Section, TaxelPanels
from rigctl.config.names import shorten

SIZE_IN = (9.6, 8.6)
MAX_LETTERS = 110
"""Of the words below the title: the clock stands beside them."""
MOVIE_S = 10.0
"""How long a movie plays, whatever the length of the section."""


def write_taxel_movie(
    course: TaxelCourse,
    section: Section,
    out: Path,
    progress: Progress,
    movie_s: float = MOVIE_S,
) -> None:
    """Write the movie of a section, which plays for ``movie_s``; for ``.png`` its last frame.

    Raises as :func:`rigctl.analysis.animation.movie_file.write_movie_file` does.
    """
    write_movie_file(partial(taxel_movie, course, section, movie_s), out, progress)


def taxel_movie(course: TaxelCourse, section: Section, movie_s: float = MOVIE_S) -> Movie:
    """Return the movie of a section of a trial."""
    import matplotlib as mpl

    figure = new_movie_figure(SIZE_IN)
    with mpl.rc_context(STYLE):
        grid = {"left": 0.1, "right": 0.985, "top": 0.905, "bottom": 0.085, "hspace": 0.16}
        ratios = {"height_ratios": HEIGHTS_OF_2D, **grid}
        rows = figure.subplots(len(HEIGHTS_OF_2D), 1, sharex=True, gridspec_kw=ratios)
        panels = TaxelPanels(list(rows), course, section)
    figure.align_ylabels(rows)
    foot = f"{course.origin} · {_pace(section, movie_s)}"
    words = shorten(course.words, MAX_LETTERS)
    write_head(figure, course.title, words, foot, course.simulated)
    clock = write_clock(figure)
    n_frames = ceil(movie_s / FRAME_S) + 1

    def set_frame(number: int) -> None:
        share = number / (n_frames - 1)
        at_s = section.start_s + share * (section.end_s - section.start_s)
        panels.show_until(at_s)
        clock.set_text(f"{at_s:.3f} s")

    return Movie(figure, n_frames, set_frame)


def _pace(section: Section, movie_s: float) -> str:
    """Return how fast the movie plays, in words."""
    slower = movie_s / (section.end_s - section.start_s)
    if slower < 1:
        return f"plays {1 / slower:.3g} times faster than real time"
    return f"plays {slower:.3g} times slower than real time"
