"""Figures of results as values: panels of curves and confusion matrices, before they are drawn.

The report's page, its files and the window draw the same :class:`Figure`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

COLOURS = {
    "ink": "#111111",
    "red": "#c8102e",
    "blue": "#1f4fd1",
    "green": "#1a8a34",
    "text": "#1b1f24",
    "muted": "#59636e",
    "line": "#e3e7eb",
    "page": "#ffffff",
}
"""On paper; the page's style sheet has another value for each name on a dark screen."""


class PublishedValue(NamedTuple):
    """A value of the paper at one place, for example at 50 components, in words too."""

    x: float
    y: float
    text: str


@dataclass(frozen=True, slots=True)
class Series:
    """One curve. ``colour``: a name of :data:`COLOURS`.

    ``spread``: half the length of each bar, None for none. ``stars``: "", "*" or "**" at each x;
    ``worse``: where the asterisks say that the curve is below its reference.
    """

    name: str
    colour: str
    x: Sequence[float]
    y: Sequence[float]
    spread: Sequence[float] | None = None
    stars: Sequence[str] = ()
    worse: Sequence[bool] = ()
    published: Sequence[PublishedValue] = ()
    dashed: bool = False

    def words_at(self, x: float, unit: str) -> str:
        """Return the value at x with bar, asterisks and the paper's value; empty without any."""
        words = []
        if x in self.x:
            i = self.x.index(x)
            spread = f" ± {self.spread[i]:.2f}" if self.spread is not None else ""
            stars = f" {self.stars[i]}" if self.stars and self.stars[i] else ""
            words.append(f"{self.y[i]:.2f}{spread} {unit}{stars}")
        words += [one.text for one in self.published if one.x == x]
        return "; ".join(words)


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves on common axes. ``level``: a dotted line with its text, such as chance.

    ``unit``: of the values. ``x_name``: precedes the x that the pointer is at.
    """

    title: str
    series: Sequence[Series]
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    unit: str = "%"
    x_name: str = ""
    level: tuple[float, str] | None = None

    @property
    def starred(self) -> list[Series]:
        """The curves with asterisks: each has a row of them above the plot."""
        return [one for one in self.series if any(one.stars)]

    def places(self) -> list[float]:
        """Return each x at which a curve or the paper has a value, ascending."""
        ours = {x for one in self.series for x in one.x}
        return sorted(ours | {value.x for one in self.series for value in one.published})


@dataclass(frozen=True, slots=True)
class Matrix:
    """A confusion matrix. ``counts``: trials by true (row) and predicted class.

    ``subtitle``: lines below the title.
    """

    title: str
    subtitle: Sequence[str]
    classes: Sequence[str]
    counts: Sequence[Sequence[int]]


@dataclass(frozen=True, slots=True)
class Figure:
    """Panels with one legend. ``notes``: sentences below them, what bars and marks mean."""

    title: str
    panels: Sequence[Panel | Matrix]
    notes: Sequence[str] = ()
    columns: int = 3
