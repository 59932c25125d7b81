"""Names that a session may hold are drawn and written as text: no formula, no HTML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from rigctl.analysis.report import vega
from rigctl.analysis.report.figure import Figure, Matrix, Panel, Series
from rigctl.analysis.report.figures import new_figure, save_figure
from rigctl.analysis.report.html_page import render_page


@pytest.mark.parametrize("name", ["$\\frac$", "$A$", "$", "<script>", "a_{b"])
def test_a_name_is_no_formula(tmp_path: Path, name: str) -> None:
    figure, axes = new_figure((3, 2), 1, 1)
    axes.set_title(name)
    axes.bar([0, 1], [1, 2], label=name)
    axes.set_xticks([0, 1], [name, "B"])
    axes.legend()
    png = save_figure(figure, tmp_path / "figure", name, name)
    svg = png.with_suffix(".svg").read_text(encoding="utf-8")
    assert svg.count(name.replace("<", "&lt;").replace(">", "&gt;")) >= 5


@pytest.mark.parametrize(
    "name", ["$A$", "<script>alert(1)</script>", 'a" onload="b', "x.y[0]", "0.123456789"]
)
def test_a_name_is_no_markup_and_no_expression(tmp_path: Path, name: str) -> None:
    series = Series(name, "ink", [1.0, 2.0], [50.0, 60.0])
    panel = Panel(name, [series], name, name, (0.0, 3.0), (0.0, 100.0), level=(20.0, name))
    matrix = Matrix(name, [name], [name, "B"], [[3, 1], [0, 4]])
    png = vega.save_figure(Figure(name, [panel, matrix], [name]), tmp_path / "figure", name)
    svg = ElementTree.parse(png.with_suffix(".svg")).getroot()
    assert [*svg.itertext()].count(name) >= 8
    assert not [one for one in svg.iter() if one.tag.endswith("script") or "onload" in one.attrib]


def test_a_page_escapes_every_value() -> None:
    page = render_page(
        "orders.html",
        made="<script>alert(1)</script>",
        sets=[{"trials": {"used": 1}, "simulated": True, "settings": {"iterations": 1}}],
        set_names=["<img src=x onerror=alert(1)>"],
        tasks={},
        sentences=["<b>bold</b>"],
        unconfirmed=[],
        ablation_sets=[],
    )
    for tag in ("<script>alert", "<img src=x", "<b>bold"):
        assert tag not in page
    assert "&lt;img src=x" in page
