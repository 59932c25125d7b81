"""Curves of a lab's own Python file, beside a real engine on the virtual rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.live.own_plots import OwnPlots
from tests.gui.rig_window import RigWindow, rig_window
from tests.gui.steps import click

HOW_TO = Path(__file__).parents[3] / "docs" / "how-to"
EXAMPLE = HOW_TO / "own_plots.py"
GOOD = "def curves(block):\n    return {'newest': (block.samples[-1, 0], 'counts')}\n"
RAISES = "def curves(block):\n    print('hello')\n    return 1 / 0\n"
ENDLESS = "def curves(block):\n    while True:\n        pass\n"
WRONG = {
    "def curves(block:\n": "own.py, line 1: SyntaxError",
    "curves = 5\n": "own.py: TypeError: it has no curves(block)",
    "def curves(block):\n    return 5\n": "own.py, line 1: TypeError: curves(block) returns {name:",
    "def curves(block):\n    return {'a': ([1, 2, 3] * 999, 'V')}\n": "'a' has the shape (2997,)",
    "import os\nos._exit(3)\n": "own.py: its process ended (code 3)",
}


@pytest.fixture(scope="module")
def rig(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigWindow]:
    """Yield a window with an engine."""
    with rig_window(qapp, "virtual", tmp_path_factory.mktemp("plots")) as opened:
        yield opened


@pytest.fixture
def page(rig: RigWindow) -> Iterator[OwnPlots]:
    """Yield the page, shown by the menu; leave it by its button."""
    actions = {action.text(): action for _, action in rig.window.menus.actions()}
    actions["&Own plots"].trigger()
    page = rig.window.own_plots
    assert page.isVisible()
    yield page
    click(page.back)
    assert rig.window.live_page.isVisible() and not page.isVisible()


def _load(page: OwnPlots, path: Path) -> None:
    """Type the file's path and press Return."""
    page.file.setText(str(path))
    QTest.keyClick(page.file, Qt.Key.Key_Return)


def _newest(page: OwnPlots) -> int:
    return min((len(values) for values in page.plots.values.values()), default=0)


def test_the_example_of_the_docs_draws_its_curves(rig: RigWindow, page: OwnPlots) -> None:
    assert EXAMPLE.read_text() in (HOW_TO / "own-plots.md").read_text()
    _load(page, EXAMPLE)
    rig.until(lambda: _newest(page) > 500)
    assert list(page.plots.plots) == ["counts", "spikes/s"]
    labels = [plot.getAxis("left").labelText for plot in page.plots.plots.values()]
    assert labels == ["counts", "spikes/s"]
    assert 0 < page.plots.values["top layer"][-1] < 1024
    pens = [line.opts["pen"] for line in page.plots.lines.values()]
    for one, other in (pens[:2], pens[2:]):
        assert one.color() != other.color() and one.style() != other.style()


def test_a_file_that_raises_is_named_and_loads_once_it_is_saved(
    rig: RigWindow, page: OwnPlots, tmp_path: Path
) -> None:
    file = tmp_path / "own.py"
    file.write_text(RAISES)
    _load(page, file)
    sentence = "own.py, line 3: ZeroDivisionError: division by zero. Correct the file and save it"
    rig.until(lambda: page.text.text() == sentence)
    file.write_text(GOOD)
    rig.until(lambda: _newest(page) > 50)
    draft = tmp_path / "draft"
    draft.write_text(GOOD.replace("newest", "renamed"))
    draft.replace(file)  # as most editors save
    rig.until(lambda: list(page.plots.units) == ["renamed"])
    click(page.reload)
    rig.until(lambda: _newest(page) > 50)


def test_a_file_that_never_returns_holds_nothing_up(
    rig: RigWindow, page: OwnPlots, tmp_path: Path
) -> None:
    file = tmp_path / "own.py"
    file.write_text(ENDLESS)
    _load(page, file)
    rig.until(lambda: "own.py: no curves for" in page.text.text())
    told_s, drawn = rig.status.at_s, rig.window.live_plots.data.history.newest
    rig.until(lambda: page.text.text().startswith("own.py, line "))
    assert "no answer within 5 s" in page.text.text()
    assert rig.status.at_s > told_s + 1 and rig.status.frame_rate_hz > 900
    assert rig.window.live_plots.data.history.newest > drawn + 1000, "the views get all samples"
    file.write_text(GOOD)
    rig.until(lambda: _newest(page) > 50)


@pytest.mark.parametrize("source", WRONG)
def test_what_is_no_file_of_curves_is_a_sentence(
    rig: RigWindow, page: OwnPlots, tmp_path: Path, source: str
) -> None:
    file = tmp_path / "own.py"
    file.write_text(source)
    _load(page, file)
    rig.until(lambda: WRONG[source] in page.text.text())
    assert rig.window.engine_link.is_connected
