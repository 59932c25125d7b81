"""The script of a report's page, run on a real chart: pointer, keys, switches and printing."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from jinja2 import Environment, PackageLoader
from PySide6.QtQml import QJSEngine
from PySide6.QtWidgets import QApplication

from rigctl.analysis.report import charts
from rigctl.analysis.report.charts.line_chart import ChartMark, ChartSeries, LineChart, LinePanel

HOSTILE = "</script><img src=x onerror=alert(1)>"
VOID = {"input", "path", "image", "img", "meta", "circle"}
TEMPLATES = Path(charts.__file__).parents[1] / "templates"


class Elements(HTMLParser):
    """Nested lists of tag, attributes, children and text, as the page's document has them."""

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[list[Any]] = [["document", {}, [], ""]]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element: list[Any] = [tag, {key: value or "" for key, value in attrs}, [], ""]
        self.stack[-1][2].append(element)
        if tag not in VOID:
            self.stack.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.stack.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            self.stack.pop()

    def handle_data(self, data: str) -> None:
        self.stack[-1][3] += data.strip("\n ")


def chart_page() -> str:
    """A chart of two curves, one with a hostile name, and explanations that are folded."""
    x = [1.0, 2.0, 3.0]
    series = [
        ChartSeries("a", "Original", "ink", x, [10.0, 20.0, 30.0]),
        ChartSeries("b", HOSTILE, "red", x, [40.0, 50.0, 60.0], [1.0, 2.0, 3.0], ["", "", "**"],
                    marks=[ChartMark(3.0, 62.0, "the paper 62.00 ± 0.10 %")]),
    ]  # fmt: skip
    panel = LinePanel("Task", series, "components", "accuracy (%)", (0.0, 4.0), (0.0, 100.0))
    environment = Environment(loader=PackageLoader("rigctl.analysis.report"), autoescape=True)
    page = environment.from_string(
        '{% from "_charts.html" import line_chart %}{{ line_chart(chart, origin) }}'
        "<details></details><details class=long></details>"
    )
    return page.render(chart=LineChart("Chart", [panel], ["Note."]), origin="Made by hand")


class Page:
    """The chart in a document with its script; ``run`` returns the value of an expression."""

    def __init__(self) -> None:
        elements = Elements()
        elements.feed(chart_page())
        assert len(elements.stack) == 1, "every element is closed"
        self._engine = QJSEngine()
        self.run(f"var PAGE = {json.dumps(elements.stack[0])}")
        self.run((Path(__file__).parent / "small_dom.js").read_text("utf-8"))
        self.run((TEMPLATES / "charts.js").read_text("utf-8"))
        self.run("var svg = document.querySelectorAll('svg').slice(-1)[0]")
        self.run("var box = document.querySelector('.values')")

    def run(self, code: str) -> Any:
        value = self._engine.evaluate(code)
        assert not value.isError(), value.toString()
        return value.toVariant()

    def switch(self, key: str) -> None:
        self.run(
            "document.querySelectorAll('[data-switch]').forEach(function (one) {"
            f"if (one.getAttribute('data-switch') === '{key}')"
            "{ one.checked = !one.checked; one.fire('change'); } })"
        )


@pytest.fixture(scope="module", autouse=True)
def application(qapp: QApplication) -> None:
    """Start the application of this process, which the engine of the script needs."""


@pytest.fixture
def page() -> Page:
    return Page()


def test_the_pointer_shows_the_values_of_every_curve_at_the_nearest_place(page: Page) -> None:
    assert page.run("box.hidden")
    page.run("svg.fire('pointermove', {clientX: 390})")
    text = page.run("box.textContent")
    assert "components 3" in text and "30.0 %" in text and "60.0 ± 3.0 % **" in text
    assert "the paper 62.00 ± 0.10 %" in text
    assert text.index("60.0") < text.index("30.0"), "the highest curve comes first"
    page.run("svg.fire('pointermove', {clientX: 60})")
    assert "components 1" in page.run("box.textContent")
    assert "the paper" not in page.run("box.textContent")
    page.run("svg.fire('pointerleave')")
    assert page.run("box.hidden")


def test_the_arrow_keys_move_along_the_curves(page: Page) -> None:
    key = "svg.fire('keydown', {key: '%s', preventDefault: function () {}})"
    for name, shown in (("ArrowLeft", 3), ("ArrowLeft", 2), ("ArrowRight", 3), ("ArrowRight", 3)):
        page.run(key % name)
        assert f"components {shown}" in page.run("box.textContent")
    page.run(key % "Escape")
    assert page.run("box.hidden")


def test_a_curve_that_is_switched_off_is_gone_from_panel_and_values(page: Page) -> None:
    page.switch("a")
    shown = (
        "document.querySelectorAll('[data-series]').map(function (g) { return g.style.display; })"
    )
    assert page.run(shown) == ["none", ""]
    page.run("svg.fire('pointermove', {clientX: 390})")
    assert "Original" not in page.run("box.textContent")
    page.switch("b")
    page.run("svg.fire('pointermove', {clientX: 390})")
    assert page.run("box.hidden")
    page.switch("a")
    assert page.run(shown) == ["", "none"]


def test_paper_has_what_is_folded_and_the_screen_has_it_folded_again(page: Page) -> None:
    states = "document.querySelectorAll('details').map(function (one) { return one.open; })"
    page.run("window.fire('beforeprint')")
    assert page.run(states) == [True, False]
    page.run("window.fire('afterprint')")
    assert page.run(states) == [False, False]


def test_a_name_stays_text_in_the_script_and_in_the_values(page: Page) -> None:
    assert HOSTILE not in chart_page() and "<img" not in chart_page()
    page.run("svg.fire('pointermove', {clientX: 390})")
    assert HOSTILE in page.run("box.textContent")
