"""The charts of a report's page: where curves, ticks, marks and asterisks lie, and their script."""

from __future__ import annotations

from typing import Any

import pytest

from rigctl.analysis.report.charts.accuracy_charts import accuracy_chart
from rigctl.analysis.report.charts.line_chart import (
    ChartMark,
    ChartSeries,
    LinePanel,
    line_path,
    nice_ticks,
)


def panel(*series: ChartSeries) -> LinePanel:
    """A panel of 0 to 10 by 0 to 100 %."""
    return LinePanel("Task", series, "components", "accuracy (%)", (0.0, 10.0), (0.0, 100.0))


def test_a_value_lies_at_its_place_inside_the_plot() -> None:
    empty = panel()
    assert (empty.place_x(0.0), empty.place_x(10.0)) == (empty.left, empty.right)
    assert (empty.place_y(0.0), empty.place_y(100.0)) == (empty.bottom, empty.top)
    assert empty.place_y(130.0) == empty.top and empty.place_y(-5.0) == empty.bottom
    assert [tick.text for tick in empty.y_ticks] == ["0", "20", "40", "60", "80", "100"]


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0, 51, [0, 10, 20, 30, 40, 50]),
        (0, 3, [0, 0.5, 1, 1.5, 2, 2.5, 3]),
        (0, 13, [0, 5, 10]),
        (3, 4, None),
    ],
)
def test_ticks_are_round_and_few(low: float, high: float, ticks: list[float] | None) -> None:
    found = nice_ticks(low, high)
    assert low <= found[0] and found[-1] <= high and 2 <= len(found) <= 7
    assert ticks is None or found == ticks


def test_numbers_of_components_are_whole() -> None:
    one = ChartSeries("a", "A", "ink", [1.0, 2.0], [50.0, 60.0])
    few = LinePanel("T", [one], "components", "accuracy (%)", (0.0, 3.0), (0.0, 100.0))
    assert [tick.text for tick in few.x_ticks] == ["0", "1", "2", "3"]


def test_each_curve_with_asterisks_has_a_row_of_its_own_above_the_plot() -> None:
    x, y = [1.0, 2.0, 3.0], [10.0, 20.0, 30.0]
    plain = ChartSeries("a", "A", "ink", x, y)
    better = ChartSeries("b", "B", "red", x, y, stars=["", "*", "**"])
    worse = ChartSeries("c", "C", "blue", x, y, stars=["*", "", ""], worse=[True, False, False])
    both = panel(plain, better, worse)
    assert both.starred == [better, worse] and both.top > panel(plain).top
    rows = both.asterisks(better)
    assert [star.x for star in rows] == [both.place_x(2.0)] + [both.place_x(3.0)] * 2
    assert all(star.y < both.top and not star.worse for star in rows)
    (grey,) = both.asterisks(worse)
    assert grey.worse and grey.y > max(star.y for star in rows)


def test_bars_are_as_long_as_the_spread_and_a_path_starts_at_its_first_point() -> None:
    one = ChartSeries("a", "A", "ink", [5.0], [50.0], [10.0], marks=[ChartMark(5.0, 40.0, "x")])
    chart = panel(one)
    middle = chart.place_x(5.0)
    assert chart.bars(one) == f"M{middle:g} {chart.place_y(40.0):g}V{chart.place_y(60.0):g}"
    assert line_path([(1.0, 2.0), (3.5, 1.0)]) == "M1 2l2.5 -1"
    assert line_path([]) == ""


def test_figure_3_shows_the_papers_value_at_50_components() -> None:
    curve = {"mean": [0.2, 0.4, 0.5, 0.6], "sd": [0.1, 0.1, 0.0, 0.1]}
    task: dict[str, Any] = {
        "title": "Individual textures", "figure": "Fig. 3A", "k_max": 4, "chance": 0.25,
        "paper": {"original": [91.78, 0.55]},
        "representations": {"speed": curve, "original": {**curve, "sd": None}},
    }  # fmt: skip
    test = {"rule": "* p < 0.05", "stars": ["", "*", "", ""], "effect": [None, -0.7, 0.0, 0.0]}
    results = {
        "settings": {"iterations": 2}, "tasks": {"textures": task}, "tests_note": "Ours alone.",
        "curve_tests": {"textures": {"speed": test}},
    }  # fmt: skip
    chart = accuracy_chart(results)
    first = chart.panels[0]
    assert [name for _, _, name in chart.legend][:2] == ["Original", "Speed Scaled"]
    (mark,) = first.series[0].marks
    assert (mark.x, mark.y) == (50.0, 91.78) and "91.78 ± 0.55" in mark.text
    assert first.x_range[1] > 50.0
    assert any("Table 1" in note for note in chart.notes)
    assert any(note.endswith("is better: * p < 0.05. Ours alone.") for note in chart.notes)
    assert [star.worse for star in first.asterisks(first.series[1])] == [True]
