"""The picture of the movie: panels on one figure, redrawn for each frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.finger.movie.answer_panel import AnswerPanel
from rigctl.analysis.finger.movie.movie_frame import FRAME_S, MovieFrame
from rigctl.analysis.finger.movie.movie_panels import (
    FeaturesPanel,
    MoviePanel,
    PlatePanel,
    ReadingsPanel,
    SpikesPanel,
    VelocityPanel,
)
from rigctl.analysis.finger.movie.scan_timeline import ScanTimeline
from rigctl.analysis.report.figures import MUTED, STYLE, TEXT, show_dollars
from rigctl.values import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIZE_IN = (11.2, 6.5)
DPI = 100
SIMULATED = "#8a4600"

PLATE = (0.052, 0.676, 0.93, 0.202)
READINGS, VELOCITY = (0.052, 0.34, 0.25, 0.255), (0.052, 0.095, 0.25, 0.205)
SPIKES, FEATURES = (0.345, 0.34, 0.375, 0.255), (0.345, 0.095, 0.375, 0.195)
ANSWER, BARS = (0.79, 0.385, 0.2, 0.23), (0.835, 0.095, 0.155, 0.235)
"""Left, bottom, width and height of the axes, as shares of the figure."""


class MovieFigure:
    """The figure of a scan; :meth:`show` sets one moment of it, :meth:`draw` draws it."""

    def __init__(self, timeline: ScanTimeline) -> None:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=SIZE_IN, dpi=DPI)
        self._canvas: Any = FigureCanvasAgg(self.figure)
        with mpl.rc_context(STYLE):
            self._panels = _panels(self.figure, timeline)
        _head(self.figure, timeline)
        self._clock = self.figure.text(
            0.99, 0.94, "", ha="right", size=19, color=TEXT, weight="bold"
        )

    def show(self, frame: MovieFrame) -> None:
        """Set what the next drawing shows."""
        for panel in self._panels:
            panel.update(frame)
        self._clock.set_text(f"{frame.scan_s:.2f} s   {frame.distance_mm:.0f} mm")
        show_dollars(self.figure)

    def draw(self, frame: MovieFrame) -> NDArray[np.uint8]:
        """Draw a frame; return its pixels, uint8 (height, width, 3), valid until the next one."""
        self.show(frame)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3]


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


def _head(figure: Figure, timeline: ScanTimeline) -> None:
    figure.text(0.012, 0.957, title_of(timeline), size=14, color=TEXT, weight="bold")
    figure.text(0.012, 0.926, words_of(timeline), size=9.5, color=MUTED)
    figure.text(0.012, 0.012, foot_of(timeline), size=8, color=MUTED)
    if timeline.simulated:
        box = {"boxstyle": "round,pad=0.35", "fc": "#fff3e0", "ec": SIMULATED, "lw": 0.8}
        figure.text(0.64, 0.947, "SIMULATED", size=10, color=SIMULATED, weight="bold", bbox=box)
