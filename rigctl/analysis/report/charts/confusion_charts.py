"""Confusion matrices for the page, from the values of ``results.json``: the paper's S1 to S4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from rigctl.analysis.comparisons import NAME_OF

Values = Mapping[str, Any]

CONFUSION_TASKS = (
    "untrained-both",
    "leave-speed-out",
    "leave-force-out",
    "textures",
    "groups",
    "leave-mount-out",
)
"""The task whose matrices are shown is the first of these; S1 to S4 are of the first one."""
MAX_CLASSES = 40
"""Larger matrices are an image on the page, in which a cell cannot be hovered."""
MARGIN, LETTER = 11.0, 6.0
SIDE, WIDTH = 320.0, 345.0
"""Wished side of a matrix, and least width of its SVG: every text has the same size on the page."""
SMALLEST_CELL, LARGEST_CELL = 20.0, 44.0
FAINTEST_TEXT, DARK_SHARE = 0.005, 0.55
MAX_LETTERS = 14


class ConfusionCell(NamedTuple):
    """A cell with trials: its corner in the SVG, its share of the row, and ``title`` if hovered."""

    x: float
    y: float
    share: float
    title: str

    @property
    def text(self) -> str:
        """The share in per cent, empty below half a per cent."""
        return f"{100 * self.share:.0f}" if self.share >= FAINTEST_TEXT else ""

    @property
    def dark(self) -> bool:
        """Whether the text needs the page's colour to be legible."""
        return self.share > DARK_SHARE


@dataclass(frozen=True, slots=True)
class ConfusionPanel:
    """One matrix; ``classes``: names of rows (true) and columns (predicted).

    ``paper``: the share in the paper's caption, empty where it has none.
    """

    title: str
    paper: str
    note: str
    classes: tuple[str, ...]
    cells: tuple[ConfusionCell, ...]

    @property
    def left(self) -> float:
        """Left edge of the matrix, right of the names."""
        return 2 * MARGIN + LETTER * max(map(len, self.labels))

    @property
    def cell(self) -> float:
        """Width and height of a cell."""
        return cell_side(len(self.classes))

    @property
    def side(self) -> float:
        """Width and height of the matrix."""
        return self.cell * len(self.classes)

    @property
    def width(self) -> float:
        """Width of the SVG."""
        return max(self.left + self.side + 2.0, WIDTH)

    @property
    def labels(self) -> list[str]:
        """Names of the classes, long ones cut."""
        cut = MAX_LETTERS - 1
        return [f"{c[:cut]}…" if len(c) > MAX_LETTERS else c for c in self.classes]

    @property
    def places(self) -> list[tuple[float, str]]:
        """The middle of each row or column with its label."""
        return [(self.cell * (i + 0.5), label) for i, label in enumerate(self.labels)]

    @property
    def upright(self) -> bool:
        """Whether the names of the columns have room beside each other."""
        return max(map(len, self.labels)) <= 2


@dataclass(frozen=True, slots=True)
class ConfusionChart:
    """The matrices of one task. ``panels`` is empty where there are too many classes."""

    task: Values
    panels: tuple[ConfusionPanel, ...]


def confusion_charts(results: Values) -> list[ConfusionChart]:
    """Return the matrices of each task, the one of the paper's S1 to S4 or its stand-in first."""
    tasks = results["tasks"]
    first = [key for key in CONFUSION_TASKS if key in tasks][:1]
    order = [*first, *(key for key in tasks if key not in first)]
    return [_chart(tasks[key]) for key in order]


def _chart(task: Values) -> ConfusionChart:
    if len(task["classes"]) > MAX_CLASSES:
        return ConfusionChart(task, ())
    keys = [key for key in NAME_OF if key in task["representations"] and "blind" not in key]
    return ConfusionChart(task, tuple(_panel(task, key) for key in keys))


def _panel(task: Values, key: str) -> ConfusionPanel:
    curve, share = task["representations"][key], task["confusion_shares"][key]
    paper = share["paper"]
    title = f"{NAME_OF[key]}: {share['percent']:.2f} %"
    caption = f"the paper's {paper['figure']}: {paper['percent']:.2f} %" if paper else ""
    tested = [sum(row) for row in curve["confusion"]]
    each = f"{max(tested):,}" if min(tested) == max(tested) else f"{min(tested):,}–{max(tested):,}"
    knows = "; C knew the texture" if curve["c_knows_the_label"] else ""
    cells = tuple(
        _cell(task["classes"], row, column, count, tested[row])
        for row, counts in enumerate(curve["confusion"])
        for column, count in enumerate(counts)
        if count
    )
    note = f"% of {each} trials a row{knows}"
    return ConfusionPanel(title, caption, note, tuple(task["classes"]), cells)


def _cell(classes: list[str], row: int, column: int, count: int, tested: int) -> ConfusionCell:
    share = count / tested
    taken = f"{classes[row]} taken for {classes[column]}" if row != column else classes[row]
    title = f"{taken}: {count:,} of {tested:,} trials ({share:.1%})"
    side = cell_side(len(classes))
    return ConfusionCell(side * column, side * row, round(share, 3), title)


def cell_side(n_classes: int) -> float:
    """Return the side of a cell, so that few classes are not huge and many are legible."""
    return round(min(max(SIDE / n_classes, SMALLEST_CELL), LARGEST_CELL), 1)
