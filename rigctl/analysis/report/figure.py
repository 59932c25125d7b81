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
    "violet": "#7a3fc4",
    "brown": "#8a5a00",
    "light-blue": "#6387e6",
    "light-green": "#459e5e",
    "teal": "#007c80",
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

    ``spread``: half the length of each bar, or its ends; None for none.
    ``stars``: "", "*" or "**" at each x.
    ``worse``: where the asterisks say that the curve is below its reference.
    """

    name: str
    colour: str
    x: Sequence[float]
    y: Sequence[float]
    spread: Sequence[float] | Sequence[tuple[float, float]] | None = None
    stars: Sequence[str] = ()
    worse: Sequence[bool] = ()
    published: Sequence[PublishedValue] = ()
    dashed: bool = False

    def words_at(self, x: float, unit: str) -> str:
        """Return the value at x with bar, asterisks and the paper's value; empty without any."""
        words = []
        if x in self.x:
            i = self.x.index(x)
            stars = f" {self.stars[i]}" if self.stars and self.stars[i] else ""
            words.append(f"{self.y[i]:.2f}{self._spread_words(i)} {unit}{stars}")
        words += [one.text for one in self.published if one.x == x]
        return "; ".join(words)

    def ends(self, i: int) -> tuple[float, float] | None:
        """Return where the bar of a point begins and ends, None without one."""
        if self.spread is None:
            return None
        half = self.spread[i]
        return half if isinstance(half, tuple) else (self.y[i] - half, self.y[i] + half)

    def _spread_words(self, i: int) -> str:
        half = None if self.spread is None else self.spread[i]
        if half is None:
            return ""
        return f" ({half[0]:.2f} to {half[1]:.2f})" if isinstance(half, tuple) else f" ± {half:.2f}"


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
class Bars:
    """Values of named things beside each other: a group of bars for each of ``categories``.

    ``series``: one value for each category; their ``x`` counts the categories from 0.
    """

    title: str
    categories: Sequence[str]
    series: Sequence[Series]
    x_label: str
    x_range: tuple[float, float]
    level: tuple[float, str] | None = None


@dataclass(frozen=True, slots=True)
class Raster:
    """Spikes as ticks, a row for each train: ``rows`` by name, from the top.

    ``series``: one for each row, its ``x`` the times of the spikes; ``y`` counts the row from 0.
    """

    title: str
    rows: Sequence[str]
    series: Sequence[Series]
    x_label: str
    x_range: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Traces:
    """Courses of several signals above each other, one a row; ``values``: from 0, one a ms."""

    title: str
    values: Sequence[Sequence[float]]
    x_label: str
    y_label: str
    x_range: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Image:
    """Values of named rows and columns as colours.

    The scale is even about ``middle``, or without one from 0 to the highest value.
    """

    title: str
    rows: Sequence[str]
    columns: Sequence[str]
    values: Sequence[Sequence[float | None]]
    x_label: str
    y_label: str
    middle: float | None = 0.0


@dataclass(frozen=True, slots=True)
class Matrix:
    """A confusion matrix. ``counts``: trials by true (row) and predicted class.

    ``name``: of the representation. ``subtitle``: lines below the title.
    """

    name: str
    subtitle: Sequence[str]
    classes: Sequence[str]
    counts: Sequence[Sequence[int]]

    @property
    def title(self) -> str:
        """The name with the share of right answers."""
        n = sum(map(sum, self.counts))
        right = sum(row[i] for i, row in enumerate(self.counts))
        return f"{self.name}: {100 * right / n:.2f} %" if n else self.name

    def share(self, row: int, column: int) -> float:
        """Return the share of a cell in its row, 0 where the class has no trials."""
        return self.counts[row][column] / max(sum(self.counts[row]), 1)

    def words(self, row: int, column: int) -> str:
        """Return true and predicted class, trials and share of a cell."""
        true, predicted = self.classes[row], self.classes[column]
        taken = true if row == column else f"{true} taken for {predicted}"
        count, tested = self.counts[row][column], sum(self.counts[row])
        return f"{taken}: {count:,} of {tested:,} trials ({self.share(row, column):.1%})"


@dataclass(frozen=True, slots=True)
class Figure:
    """Panels with one legend. ``notes``: sentences below them, what bars and marks mean."""

    title: str
    panels: Sequence[Panel | Matrix | Bars | Raster | Traces | Image]
    notes: Sequence[str] = ()
    columns: int = 3

    @property
    def plots(self) -> list[Panel]:
        """The panels of curves."""
        return [one for one in self.panels if isinstance(one, Panel)]

    @property
    def matrices(self) -> list[Matrix]:
        """The confusion matrices."""
        return [one for one in self.panels if isinstance(one, Matrix)]

    @property
    def legend(self) -> dict[str, Series]:
        """The curves by name, each once."""
        return {
            one.name: one
            for plot in self.panels
            if not isinstance(plot, Matrix | Traces | Image)
            for one in plot.series
        }
