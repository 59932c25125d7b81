"""The figures of a report: their values, what is drawn of them, and where they come from."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rigctl.analysis.report import vega
from rigctl.analysis.report.figure import COLOURS, Figure, Matrix, Panel, PublishedValue, Series
from rigctl.analysis.report.figures import train_groups
from rigctl.analysis.report.html_page import TEMPLATES
from rigctl.analysis.report.result_figures import accuracy_figure, confusion_figures
from rigctl.config.resources import checkout
from rigctl.session.sensor_layout import SensorLayout
from tests.benchmarks.encoder import _scale_page

BETTER = Series(
    "Speed Scaled", "blue", [1, 2, 3], [10.0, 20.0, 30.0], [1.0, 2.0, 3.0],
    stars=["", "*", "**"], worse=[False] * 3,
    published=[PublishedValue(4, 44.4, "the paper 44.4 %")],
)  # fmt: skip
PLAIN = Series("Original", "ink", [1, 2], [15.0, 25.0], dashed=True)
PANEL = Panel(
    "Task", [PLAIN, BETTER], "components", "accuracy (%)", (0.0, 5.0), (0.0, 100.0),
    level=(25.0, "chance 25 %"),
)  # fmt: skip


def test_the_values_at_a_place_are_those_of_every_curve_and_of_the_paper() -> None:
    assert PANEL.places() == [1, 2, 3, 4]
    assert BETTER.words_at(2, "%") == "20.00 ± 2.00 % *"
    assert BETTER.words_at(4, "%") == "the paper 44.4 %"
    assert (PLAIN.words_at(1, "%"), PLAIN.words_at(3, "%")) == ("15.00 %", "")


def test_the_pointer_has_a_place_for_every_x_without_gaps() -> None:
    (plot,) = vega.specify(Figure("F", [PANEL]), pointer=True)["concat"]
    rows = plot["layer"][-1]["data"]["values"]
    assert [(row["x"], row["right"]) for row in rows] == [
        (0, 1.5),
        (1.5, 2.5),
        (2.5, 3.5),
        (3.5, 5),
    ]
    assert (rows[1]["at"], rows[1]["s0"], rows[1]["s1"]) == ("2", "25.00 %", "20.00 ± 2.00 % *")


def test_a_drawing_has_the_values_bars_asterisks_and_texts() -> None:
    (plot,) = vega.specify(Figure("F", [PANEL]))["concat"]
    values = plot["data"]["values"]
    assert {"name": "Speed Scaled", "x": 3, "y": 30.0, "low": 27.0, "high": 33.0} in values
    assert {"name": "Original", "x": 1, "y": 15.0} in values
    svg = vega.still(vega.specify(Figure("F", [PANEL])))
    for words in (">Task<", ">chance 25 %<", ">Original<", ">**<", ">*<", ">components<"):
        assert words in svg
    assert svg.count('stroke="var(--blue)" stroke-width="0.7"') == 3, "a bar for each value"


def test_a_legend_with_long_names_is_no_wider_than_its_plots() -> None:
    """Two names of the finger's report stood side by side, far beyond the plot."""
    places = ("Trained velocity profiles", "Untrained velocity profiles")
    names = [f"{place}: {kind}" for place in places for kind in ("Original", "Speed Scaled")]
    series = [Series(name, "blue", [1, 2], [15.0, 25.0]) for name in names]
    for n_panels in (1, 2):
        drawn = []
        for curves in (series, [replace(series[0], name="a")]):
            panels = [replace(PANEL, series=curves)] * n_panels
            svg = vega.still(vega.specify(Figure("F", panels, columns=n_panels)))
            width = re.search(r'width="([\d.]+)"', svg)
            assert width is not None
            drawn.append(float(width[1]))
        assert drawn[0] <= drawn[1] + 1
    # The page's script takes as many names a row as fit the panels that it shows side by side.
    panels = [replace(PANEL, series=series)] * 3
    meta = vega.specify(Figure("F", panels))["usermeta"]
    assert meta["legend_columns"] == [1, 2, 3]


def test_bars_end_at_the_edge_of_the_plot() -> None:
    high = Series("S", "ink", [1], [95.0], [10.0])
    panel = Panel("T", [high], "x", "y", (0.0, 2.0), (0.0, 100.0))
    (plot,) = vega.specify(Figure("F", [panel]))["concat"]
    assert plot["data"]["values"] == [{"name": "S", "x": 1, "y": 95.0, "low": 85.0, "high": 100.0}]


def test_asterisks_are_in_a_row_of_their_own_and_grey_where_the_curve_is_worse() -> None:
    worse = Series("C", "red", [1, 2], [1.0, 2.0], stars=["*", ""], worse=[True, False])
    panel = Panel("T", [PLAIN, BETTER, worse], "x", "y", (0.0, 5.0), (0.0, 100.0))
    assert panel.starred == [BETTER, worse]
    svg = vega.still(vega.specify(Figure("F", [panel])))
    assert svg.count('fill="var(--muted)">*<') == 1 or 'fill="var(--muted)" opacity="1">*<' in svg


def test_colours_follow_the_page_and_are_fixed_in_files(tmp_path: Path) -> None:
    figure = Figure("Accuracy", [PANEL], ["Bars: standard deviation."])
    assert "var(--blue)" in vega.still(vega.specify(figure))
    png = vega.save_figure(figure, tmp_path / "one", "Simulated bench")
    svg = png.with_suffix(".svg").read_text("utf-8")
    assert "var(" not in svg and COLOURS["blue"] in svg
    assert ">Accuracy<" in svg and "Bars: standard deviation." in svg and "Simulated bench" in svg
    again = vega.save_figure(figure, tmp_path / "two", "Simulated bench")
    assert again.read_bytes() == png.read_bytes()
    assert again.with_suffix(".svg").read_bytes() == png.with_suffix(".svg").read_bytes()


def test_a_cell_says_its_trials_and_cells_without_trials_are_left_out() -> None:
    matrix = Matrix("Original", ["% of 4–8 trials a row"], ["A", "cord"], [[3, 1], [0, 8]])
    svg = vega.still(vega.specify(Figure("F", [matrix])))
    assert "A taken for cord: 1 of 4 trials (25.0%)" in svg
    assert svg.count("trials (") == 3
    for digits, colour in (("75", "page"), ("25", "text"), ("100", "page")):
        assert f'fill="var(--{colour})">{digits}<' in svg


def test_a_class_without_trials_and_a_matrix_of_many_classes_are_drawn() -> None:
    names = [f"texture {n}" for n in range(vega.MOST_ANNOTATED + 1)]
    counts = [[int(row == column) for column in range(len(names))] for row in range(len(names))]
    counts[0] = [0] * len(names)
    svg = vega.still(vega.specify(Figure("F", [Matrix("M", [], names, counts)])))
    assert svg.count("of 1 trials") == len(names) - 1 and ">100<" not in svg


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
    figure = accuracy_figure(results)
    (panel,) = figure.panels
    assert isinstance(panel, Panel) and panel.x_range[1] > 50.0
    original, speed = panel.series
    assert (original.name, speed.name) == ("Original", "Speed Scaled")
    assert (original.spread, speed.y) == (None, [20.0, 40.0, 50.0, 60.0])
    (value,) = original.published
    assert (value.x, value.y) == (50, 91.78) and "91.78 ± 0.55" in value.text
    assert (speed.stars, speed.worse[1]) == (["", "*", "", ""], True)
    (alone,) = accuracy_figure(results | {"tasks": {"textures": {**task, "paper": {}}}}).panels
    assert isinstance(alone, Panel) and 4.0 < alone.x_range[1] <= 5.0  # where the curves end
    assert any("Table 1" in note for note in figure.notes)
    assert any(note.endswith("is better: * p < 0.05. Ours alone.") for note in figure.notes)


def test_the_matrices_of_the_papers_task_come_first() -> None:
    paper = {"figure": "Fig. S1", "percent": 36.78}
    one = {"confusion": [[3, 1], [0, 8]], "c_knows_the_label": False}
    tasks = {
        name: {
            "title": name, "classes": ["A", "B"], "shown_components": 5,
            "representations": {"original": one, "force_blind": one},
            "confusion_shares": {"original": {"percent": 75.0, "paper": paper}},
        }
        for name in ("textures", "untrained-both")
    }  # fmt: skip
    first, second = confusion_figures({"tasks": tasks})
    assert first.title == "untrained-both: confusion with 5 components"
    assert second.title.startswith("textures")
    (matrix,) = first.panels
    assert isinstance(matrix, Matrix) and matrix.title == "Original: 91.67 %"
    assert matrix.subtitle == ["the paper's Fig. S1: 36.78 %", "% of 4–8 trials a row"]


def test_the_scripts_of_the_page_end_with_their_element() -> None:
    text = vega.scripts()
    assert "vegaEmbed" in text
    assert "</script" not in text.lower()


@pytest.mark.parametrize("name", ["style.css", "page.js"])
def test_the_page_fetches_nothing(name: str) -> None:
    assert "//" not in (TEMPLATES / name).read_text("utf-8").replace("  // ", "")


def test_a_specification_is_plain_json() -> None:
    spec = vega.specify(Figure("F", [PANEL]), pointer=True)
    assert json.loads(json.dumps(spec, allow_nan=False))["columns"] == 1


def test_the_papers_sensor_has_four_groups() -> None:
    groups = train_groups(SensorLayout.default(18))
    assert [group.name for group in groups] == ["SAI", "RAI", "SAII", "RAII"]
    assert [group.rows.start for group in groups] == [0, 18, 9, 27]
    assert groups[2].description == "slow, bottom layer"
    assert len({group.colour for group in groups}) == 4


def test_one_layer_has_a_group_for_each_channel() -> None:
    groups = train_groups(SensorLayout.default(16))
    assert [(group.name, group.description) for group in groups] == [("SA", "slow"), ("RA", "fast")]
    assert [len(group.rows) for group in groups] == [16, 16]


def test_every_layer_has_its_own_colours() -> None:
    groups = train_groups(SensorLayout(2, 2, ("I", "II", "III")))
    assert groups[-1].name == "RAIII" and groups[-1].description == "fast, layer 3 from the top"
    assert len({group.colour for group in groups}) == 6
    assert sorted(row for group in groups for row in group.rows) == list(range(24))


def test_the_page_is_rendered_from_its_rates() -> None:
    root = checkout()
    assert root is not None
    text = (root / "docs" / "explanation" / "scale.md").read_text(encoding="utf-8")
    rates = _scale_page.rates_of(text)
    assert _scale_page.render(rates) == text, "run make scale to write the page"
    assert set(_scale_page.UNITS) <= set(rates)
    full = [n for n, _ in _scale_page.growth_limits(rates)]
    assert full == sorted(full) and full[0] > 0
