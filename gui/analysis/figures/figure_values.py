"""The values of figures as tables. This module does not import Qt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gui.analysis.export.value_file import rows_csv
from rigctl.analysis.report.figure import Figure, Panel, Series

CURVE_NAMES = (
    "plot", "curve", "x is", "x", "y is", "y", "bar from", "bar to", "asterisks", "dotted line",
    "the paper's value",
)  # fmt: skip
CELL_NAMES = (
    "task", "representation", "true texture", "predicted texture", "count (trials)",
    "share of the true texture (%)",
)  # fmt: skip


def figures_csv(figures: Sequence[Figure]) -> str:
    """Return every point of every curve, or every cell of every matrix, as a row."""
    if figures[0].matrices:
        return rows_csv(CELL_NAMES, (row for one in figures for row in _cells(one)))
    return rows_csv(CURVE_NAMES, (row for one in figures for row in _points(one)))


def _points(figure: Figure) -> Iterator[tuple[object, ...]]:
    for panel in figure.plots:
        level = "" if panel.level is None else f"{panel.level[0]:.4f}"
        for one in panel.series:
            published = "; ".join(value.text for value in one.published)
            for i, (x, y) in enumerate(zip(one.x, one.y, strict=True)):
                ends = [f"{end:.4f}" for end in one.ends(i) or ()] or ("", "")
                stars = one.stars[i] if one.stars else ""
                point = (panel.x_label, f"{x:g}", panel.y_label, f"{y:.4f}", *ends)
                yield (panel.title, one.name, *point, stars, level, published)


def _cells(figure: Figure) -> Iterator[tuple[object, ...]]:
    for matrix in figure.matrices:
        for row, true in enumerate(matrix.classes):
            for column, predicted in enumerate(matrix.classes):
                percent = f"{100 * matrix.share(row, column):.4f}"
                cell = (true, predicted, matrix.counts[row][column], percent)
                yield (figure.title, matrix.name, *cell)


def point_words(panel: Panel, curve: Series, i: int) -> str:
    """Return a point of a curve in words, with the paper's values of the curve."""
    x = curve.x[i]
    words = f"{panel.title} · {curve.name}, {panel.x_name or panel.x_label} {x:g}"
    value = curve.words_at(x, panel.unit)
    others = [one.text for one in curve.published if one.x != x]
    return " · ".join([f"{words}: {value}", *others])
