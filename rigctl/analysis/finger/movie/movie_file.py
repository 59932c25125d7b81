"""Write the movie of a scan: GIF, MP4, or its last frame as PNG. The file is complete or absent."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rigctl.analysis.animation.movie import Movie
from rigctl.analysis.animation.movie_file import Progress, write_movie_file
from rigctl.analysis.finger.movie.answer_panel import RIGHT, WRONG
from rigctl.analysis.finger.movie.movie_figure import MovieFigure
from rigctl.analysis.finger.movie.movie_frame import frame_at, frame_times
from rigctl.analysis.finger.movie.scan_timeline import ScanTimeline


def write_movie(timeline: ScanTimeline, out: Path, progress: Progress) -> None:
    """Write a movie in real time, or for ``.png`` its last frame.

    Raises as :func:`rigctl.analysis.animation.movie_file.write_movie_file` does.
    """
    write_movie_file(partial(_movie, timeline), out, progress)


def _movie(timeline: ScanTimeline) -> Movie:
    times, figure = frame_times(timeline), MovieFigure(timeline)

    def set_frame(number: int) -> None:
        figure.show(frame_at(timeline, float(times[number])))

    return Movie(figure.figure, len(times), set_frame, rare_colours=(RIGHT, WRONG))
