"""Accuracy over the number of components as numbers. This module does not import Qt."""

from __future__ import annotations

import csv
import io
from typing import NamedTuple

PERCENT = "\u202f%"
HEAD = (
    "task", "representation", "components", "accuracy (%)", "spread (%)", "spread is",
    "chance (%)", "paper's accuracy (%)", "paper's standard deviation (%)", "paper's components",
    "simulated",
)  # fmt: skip


class PublishedAccuracy(NamedTuple):
    """An accuracy of the paper; ``components``: None where it says that the curve saturates."""

    percent: float
    sd_percent: float | None = None
    components: int | None = None

    def words(self) -> str:
        """Return the value in words."""
        sd = "" if self.sd_percent is None else f" ± {self.sd_percent:.2f}"
        at = "where it saturates"
        if self.components is not None:
            at = f"with {self.components} components"
        return f"paper: {self.percent:.2f}{sd}{PERCENT} {at}"


class AccuracyCurve(NamedTuple):
    """Accuracy of a representation: ``percent[k - 1]`` with k components.

    ``spread``: of the draws, in per cent, as long as ``percent``; empty for a single draw.
    """

    key: str
    name: str
    percent: tuple[float, ...]
    spread: tuple[float, ...] = ()
    paper: PublishedAccuracy | None = None


class AccuracyPanel(NamedTuple):
    """A task with its curves.

    ``spread_name``: what the bars are; ``no_spread``: why there are none.
    """

    title: str
    chance_percent: float
    curves: tuple[AccuracyCurve, ...]
    spread_name: str = "sd"
    no_spread: str = "one draw, no spread"

    @property
    def k_max(self) -> int:
        """Largest number of components."""
        return max(len(curve.percent) for curve in self.curves)

    def point_words(self, curve: AccuracyCurve, components: int) -> str:
        """Return a point of a curve in words: task, representation, components, accuracy."""
        percent = curve.percent[components - 1]
        spread = self.no_spread
        if curve.spread:
            spread = f"± {curve.spread[components - 1]:.2f}{PERCENT} {self.spread_name}"
        number = f"{components} component{'' if components == 1 else 's'}"
        value = f"{percent:.2f}{PERCENT} ({spread})"
        words = f"{self.title} · {curve.name}, {number}: {value}"
        return words if curve.paper is None else f"{words} · {curve.paper.words()}"


class AccuracyPlot(NamedTuple):
    """The tasks of a figure, and where the data come from."""

    panels: tuple[AccuracyPanel, ...]
    origin: str
    simulated: bool

    def curves(self) -> dict[str, str]:
        """Return the name of each representation by its key, each once."""
        return {curve.key: curve.name for panel in self.panels for curve in panel.curves}

    def to_csv(self) -> str:
        """Return every point of every curve as a row."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(HEAD)
        origin = "yes" if self.simulated else "no"
        for panel in self.panels:
            for curve in panel.curves:
                writer.writerows((*row, origin) for row in _rows(panel, curve))
        return out.getvalue()


def _rows(panel: AccuracyPanel, curve: AccuracyCurve) -> list[tuple[object, ...]]:
    paper = curve.paper or (None, None, None)
    return [
        (
            panel.title, curve.name, k, f"{percent:.4f}",
            f"{curve.spread[k - 1]:.4f}" if curve.spread else "",
            panel.spread_name if curve.spread else "",
            f"{panel.chance_percent:.4f}", *paper,
        )
        for k, percent in enumerate(curve.percent, start=1)
    ]  # fmt: skip
