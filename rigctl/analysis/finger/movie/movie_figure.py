"""The picture of the movie: panels on one figure, redrawn for each frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rigctl.analysis.animation.movie import (
    FRAME_S,
    Pixels,
    draw_pixels,
    new_movie_figure,
    write_clock,
    write_head,
)
from rigctl.analysis.finger.movie.answer_panel import AnswerPanel
from rigctl.analysis.finger.movie.movie_frame import MovieFrame
from rigctl.analysis.finger.movie.movie_panels import (
    FeaturesPanel,
    MoviePanel,
    PlatePanel,
    ReadingsPanel,
    SpikesPanel,
    VelocityPanel,
)
from rigctl.analysis.finger.movie.scan_timeline import ScanTimeline
from rigctl.analysis.report.figures import STYLE, show_dollars
from rigctl.values import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE_IN = (11.2, 6.5)

PLATE = (0.052, 0.676, 0.93, 0.202)
READINGS, VELOCITY = (0.052, 0.34, 0.25, 0.255), (0.052, 0.095, 0.25, 0.205)
SPIKES, FEATURES = (0.345, 0.34, 0.375, 0.255), (0.345, 0.095, 0.375, 0.195)
ANSWER, BARS = (0.79, 0.385, 0.2, 0.23), (0.835, 0.095, 0.155, 0.235)
"""Left, bottom, width and height of the axes, as shares of the figure."""


class MovieFigure:
    """The figure of a scan; :meth:`show` sets one moment of it, :meth:`draw` draws it."""

    def __init__(self, timeline: ScanTimeline) -> None:
        import matplotlib as mpl

        self.figure = new_movie_figure(SIZE_IN)
        with mpl.rc_context(STYLE):
            self._panels = _panels(self.figure, timeline)
        texts = title_of(timeline), words_of(timeline), foot_of(timeline)
        write_head(self.figure, *texts, timeline.simulated)
        self._clock = write_clock(self.figure)

    def show(self, frame: MovieFrame) -> None:
        """Set what the next drawing shows."""
        for panel in self._panels:
            panel.update(frame)
        self._clock.set_text(f"{frame.scan_s:.2f} s   {frame.distance_mm:.0f} mm")
        show_dollars(self.figure)

    def draw(self, frame: MovieFrame) -> Pixels:
        """Draw a frame; return its pixels, uint8 (height, width, 3), valid until the next one."""
        self.show(frame)
        return draw_pixels(self.figure)


def title_of(timeline: ScanTimeline) -> str:
    """Return the plate of a scan, with its texture where it is known."""
    relief = timeline.relief
    return f"Plate {timeline.trial.texture}" + (f": {relief.words}" if relief else "")


def words_of(timeline: ScanTimeline) -> str:
    """Return trial, stage and velocity profile, and the reasons where it was not committed."""
    trial = timeline.trial
    words = f"trial {trial.trial_id} of stage {trial.stage}, velocity profile {trial.profile}"
    if trial.verdict is not Verdict.COMMITTED:
        words += f"; {trial.verdict}: {'; '.join(trial.reasons)}"
    return words


def foot_of(timeline: ScanTimeline) -> str:
    """Return the origin of the scan and the movie's pace."""
    source = "Simulated finger" if timeline.simulated else "Recorded finger"
    return (
        f"{source} · session {timeline.session.name} · plays in real time, {1 / FRAME_S:g} frames "
        "a second; spikes, features and answers appear when the computer had them"
    )


def _panels(figure: Figure, timeline: ScanTimeline) -> tuple[MoviePanel, ...]:
    add: Any = figure.add_axes
    return (
        PlatePanel(add(PLATE), timeline),
        ReadingsPanel(add(READINGS), timeline),
        VelocityPanel(add(VELOCITY), timeline),
        SpikesPanel(add(SPIKES), timeline),
        FeaturesPanel(add(FEATURES), timeline),
        AnswerPanel(add(ANSWER), add(BARS), timeline),
    )
