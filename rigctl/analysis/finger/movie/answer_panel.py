"""The panel of the answer: the texture, right or wrong, and its probabilities at the moment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rigctl.analysis.finger.confidence import COVERAGE
from rigctl.analysis.finger.movie.movie_frame import MovieFrame
from rigctl.analysis.finger.movie.scan_timeline import ScanTimeline
from rigctl.analysis.report.figures import FAINT, MUTED, TEXT
from rigctl.encoding.scaled_time import N_WINDOWS
from rigctl.finger_values import PredictionRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RIGHT, WRONG = "#1a7f37", "#cf222e"
SMALL = 8


class AnswerPanel:
    """The answer large, ✓ green or ✗ red, above a bar for the probability of each texture."""

    def __init__(self, words: Axes, bars: Axes, timeline: ScanTimeline) -> None:
        self._plate = timeline.trial.texture
        self._textures = sorted({name for one in timeline.answers for name in one.probabilities})
        words.set_axis_off()
        style: dict[str, Any] = {"transform": words.transAxes, "ha": "center"}
        self._letter = words.text(0.5, 0.52, "", size=52, weight="bold", va="center", **style)
        self._says = words.text(0.5, 0.13, "", size=9.5, va="center", color=TEXT, **style)
        self._set = words.text(0.5, -0.03, "", size=SMALL, va="center", color=MUTED, **style)
        self._bars: Any = ()
        self._shares: list[Any] = []
        if self._textures:
            self._letter.set(text="–", color=FAINT)
            self._says.set_text("no answer yet")
            self._draw_bars(bars)
        else:
            self._says.set_text("this scan is not classified")
            bars.set_axis_off()

    def update(self, frame: MovieFrame) -> None:
        """Show the newest answer."""
        answer = frame.answer
        if answer is None:
            return
        correct = answer.texture == self._plate
        colour = RIGHT if correct else WRONG
        self._letter.set(text=f"{answer.texture} {'✓' if correct else '✗'}", color=colour)
        self._says.set_text(answer_words(answer))
        self._set.set_text(doubt_words(answer))
        for name, bar, share in zip(self._textures, self._bars, self._shares, strict=True):
            value = answer.probabilities.get(name, 0.0)
            bar.set_width(value)
            bar.set_color(colour if name == answer.texture else "#b6bfc9")
            share.set(text=f"{value:.0%}", x=value + 0.02)

    def _draw_bars(self, axes: Axes) -> None:
        places = range(len(self._textures))
        self._bars = axes.barh(list(places), [0.0] * len(self._textures), height=0.68)
        self._shares = [axes.text(0.02, place, "", va="center", size=SMALL) for place in places]
        names = [f"plate ▸ {name}" if name == self._plate else name for name in self._textures]
        axes.set_yticks(list(places), names)
        axes.tick_params(axis="y", length=0, labelsize=9)
        axes.tick_params(axis="x", labelsize=SMALL)
        axes.set(xlim=(0, 1.12), ylim=(len(self._textures) - 0.5, -0.5))
        axes.set_xticks([0, 0.5, 1], ["0", "50", "100"])
        axes.set_xlabel("probability (%)", size=SMALL, labelpad=1)


def answer_words(answer: PredictionRow) -> str:
    """Return what the answer rests on."""
    if answer.is_final:
        return f"final answer, {answer.seconds:.2f} s, {answer.distance_mm:.0f} mm"
    return f"so far, after {answer.windows} of {N_WINDOWS} windows"


def doubt_words(answer: PredictionRow) -> str:
    """Return how sure the answer is."""
    if not answer.known:
        return "unlike every trained texture"
    is_all = len(answer.texture_set) == len(answer.probabilities)
    names = "every texture" if is_all else " ".join(answer.texture_set)
    return f"{COVERAGE:.0%} set: {names}" + (" · sure enough to decide" if answer.decided else "")
