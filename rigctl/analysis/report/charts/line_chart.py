"""Line charts: values and axes of a panel, as the paths and labels of an inline SVG.

The templates hold the SVG itself, and ``charts.js`` adds hovering and switching to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

WIDTH, PLOT_HEIGHT = 400.0, 200.0
LEFT, RIGHT, TOP, BOTTOM = 40.0, 10.0, 22.0, 34.0
ROW_OF_STARS = 11.0
MAX_TICKS = 6
NICE_STEPS = (1.0, 2.0, 5.0, 10.0)


class ChartMark(NamedTuple):
    """A value of the paper at one place, for example at 50 components; ``text``: when hovered."""

    x: float
    y: float
    text: str


@dataclass(frozen=True, slots=True)
class ChartSeries:
    """One curve. ``key``: its switch in the legend; ``style``: classes of the style sheet.

    ``spread``: half the length of each bar, None for none. ``stars``: "", "*" or "**" at each x;
    ``worse``: where the asterisks say that the curve is below its reference.
    """

    key: str
    name: str
    style: str
    x: Sequence[float]
    y: Sequence[float]
    spread: Sequence[float] | None = None
    stars: Sequence[str] = ()
    worse: Sequence[bool] = ()
    marks: Sequence[ChartMark] = ()

    @property
    def legend(self) -> tuple[str, str, str]:
        """Key, style and name: one entry of a legend."""
        return self.key, self.style, self.name


class AxisTick(NamedTuple):
    """A tick of an axis: its place in the SVG, and its text."""

    at: float
    text: str


class StarGlyph(NamedTuple):
    """An asterisk in the SVG; ``worse``: grey, because the curve is below its reference."""

    x: float
    y: float
    worse: bool


@dataclass(frozen=True, slots=True)
class LinePanel:
    """One panel of a chart. ``level``: a dotted line with its text, such as chance.

    ``unit`` follows each hovered value; ``x_name`` precedes the hovered x.
    """

    title: str
    series: Sequence[ChartSeries]
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_name: str = ""
    unit: str = "%"
    level: tuple[float, str] | None = None
    width: float = field(default=WIDTH, init=False)

    @property
    def starred(self) -> list[ChartSeries]:
        """The curves with asterisks: each has a row of them above the plot."""
        return [one for one in self.series if any(one.stars)]

    @property
    def top(self) -> float:
        """Upper edge of the plot."""
        return TOP + ROW_OF_STARS * len(self.starred)

    @property
    def bottom(self) -> float:
        """Lower edge of the plot."""
        return self.top + PLOT_HEIGHT

    @property
    def height(self) -> float:
        """Height of the whole SVG."""
        return self.bottom + BOTTOM

    @property
    def left(self) -> float:
        """Left edge of the plot."""
        return LEFT

    @property
    def right(self) -> float:
        """Right edge of the plot."""
        return WIDTH - RIGHT

    @property
    def x_ticks(self) -> list[AxisTick]:
        """Ticks below the plot, whole ones where every curve has whole numbers only."""
        values = nice_ticks(*self.x_range)
        if all(float(x).is_integer() for one in self.series for x in one.x):
            values = [value for value in values if value.is_integer()]
        return [AxisTick(self.place_x(value), f"{value:g}") for value in values]

    @property
    def y_ticks(self) -> list[AxisTick]:
        """Ticks left of the plot."""
        return [AxisTick(self.place_y(value), f"{value:g}") for value in nice_ticks(*self.y_range)]

    def place_x(self, value: float) -> float:
        """Return the horizontal place of a value in the SVG."""
        low, high = self.x_range
        return round(self.left + (value - low) / (high - low) * (self.right - self.left), 1)

    def place_y(self, value: float) -> float:
        """Return the vertical place of a value in the SVG, inside the plot."""
        low, high = self.y_range
        inside = min(max(value, low), high)
        return round(self.bottom - (inside - low) / (high - low) * PLOT_HEIGHT, 1)

    def curve(self, one: ChartSeries) -> str:
        """Return the path of a curve."""
        return line_path([(self.place_x(x), self.place_y(y)) for x, y in self._points(one)])

    def bars(self, one: ChartSeries) -> str:
        """Return the path of a curve's vertical bars, empty without a spread."""
        if one.spread is None:
            return ""
        ends = zip(self._points(one), one.spread, strict=True)
        return "".join(
            f"M{self.place_x(x):g} {self.place_y(y - half):g}V{self.place_y(y + half):g}"
            for (x, y), half in ends
            if half
        )

    def asterisks(self, one: ChartSeries) -> list[StarGlyph]:
        """Return the asterisks of a curve: two above each other for ``**``."""
        row = TOP + ROW_OF_STARS * (self.starred.index(one) + 1) - 1.0
        worse = one.worse or [False] * len(one.stars)
        return [
            StarGlyph(self.place_x(x), row - 4.5 * n, below)
            for x, stars, below in zip(one.x, one.stars, worse, strict=True)
            for n in range(len(stars))
        ]

    @property
    def hovered(self) -> dict[str, Any]:
        """What the page needs to show values at the pointer, as values for JSON."""
        low, high = self.x_range
        return {
            "from": [self.left, low],
            "to": [self.right, high],
            "name": self.x_name or self.x_label,
            "unit": self.unit,
            "series": [self._hovered(one) for one in self.series],
        }

    def _hovered(self, one: ChartSeries) -> dict[str, Any]:
        return {
            "key": one.key,
            "name": one.name,
            "style": one.style,
            "x": [round(x, 3) for x in one.x],
            "y": [round(y, 2) for y in one.y],
            "at": [self.place_y(y) for y in one.y],
            "spread": None if one.spread is None else [round(half, 2) for half in one.spread],
            "stars": list(one.stars),
            "marks": [[mark.x, mark.text] for mark in one.marks],
        }

    @staticmethod
    def _points(one: ChartSeries) -> list[tuple[float, float]]:
        return list(zip(one.x, one.y, strict=True))


@dataclass(frozen=True, slots=True)
class LineChart:
    """Panels with one legend. ``notes``: sentences below them, what bars and marks mean."""

    name: str
    panels: Sequence[LinePanel]
    notes: Sequence[str]

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """Key, style and name of each curve, once."""
        return list(dict.fromkeys(one.legend for panel in self.panels for one in panel.series))


def line_path(points: Sequence[tuple[float, float]]) -> str:
    """Return an SVG path through points, shorter than one of absolute coordinates."""
    if not points:
        return ""
    steps = [f"l{round(b[0] - a[0], 1):g} {round(b[1] - a[1], 1):g}" for a, b in pairwise(points)]
    return f"M{points[0][0]:g} {points[0][1]:g}" + "".join(steps)


def nice_ticks(low: float, high: float) -> list[float]:
    """Return round values between two bounds, at most six."""
    span = high - low
    magnitude = 10.0 ** _exponent(span / MAX_TICKS)
    step = next(nice * magnitude for nice in NICE_STEPS if nice * magnitude * MAX_TICKS >= span)
    first = -int(-low // step)
    last = int(high // step)
    return [round(step * n, 10) for n in range(first, last + 1)]


def _exponent(value: float) -> int:
    return int(f"{value:e}".split("e")[1])
