"""No text of the window is cut off, in any page, theme and size of the screen."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QSize
from PySide6.QtWidgets import QApplication, QWidget

from gui.analysis.accuracy import AccuracyPlots
from gui.shell.main_window import TEXT_SIZES_PERCENT, MainWindow
from gui.widgets.theme import DARK, LIGHT, ThemeChoice, _style_sheet
from tests.analysis.recordings import record
from tests.gui.fake_finger import FakeFinger
from tests.gui.steps import SharedWindow
from tests.gui.texts.cut import cut_texts
from tests.gui.texts.piece import CutText
from tests.gui.texts.scenes import SESSION_NAME, SILENT, Stage, scenes

LAYOUT_PASSES = 4  # a wrapped text asks for its height once it has its width
TRIES = 5  # a timer of the window may change a text after the last pass
SIZES = ((1024, 700), (1280, 800), (1920, 1080))
COLOUR = re.compile("#[0-9a-f]{6,8}", re.IGNORECASE)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session with a long name."""
    return record(tmp_path_factory.mktemp("recorded") / SESSION_NAME, repeats=1)


def _measure(stage: Stage, shown: Iterable[str], sizes: Sequence[tuple[int, int]]) -> list[str]:
    """Return a line for each text that is cut in a state and a size."""
    window, found = stage.window, []
    for scene in shown:
        for size in sizes:
            window.setUpdatesEnabled(False)  # painting costs most, and only the last one counts
            window.resize(*size)
            QApplication.processEvents()
            if scene != SILENT:
                stage.update()
            for plots in window.findChildren(AccuracyPlots):
                if plots.isVisible():
                    plots.make_all()
            cuts = _cuts_that_stay(window)
            if window.size() != QSize(*size):
                width, height = window.size().toTuple()
                cuts.append(CutText("window", window.windowTitle(), f"needs {width} × {height} px"))
            at = f"{scene}, {size[0]}×{size[1]}"
            found += [f"{at}: {cut}" for cut in cuts]
    return found


def _cuts_that_stay(window: QWidget) -> list[CutText]:
    """Return the texts that are still cut once the window is laid out."""
    for _ in range(TRIES):
        window.setUpdatesEnabled(False)
        for _ in range(LAYOUT_PASSES):
            QApplication.processEvents()
        window.setUpdatesEnabled(True)
        # On a busy computer each pass ends with a new text, such as "3.5 s old".
        QCoreApplication.sendPostedEvents(None, QEvent.Type.LayoutRequest)
        cuts = cut_texts(window)
        if not cuts:
            break
    return cuts


def _leave_finger(window: MainWindow) -> None:
    link = window.finger_tab.link
    link.close()
    link.wait_closed()
    link.poll()


def test_themes_differ_in_colours_alone() -> None:
    """So a text that is whole in one is whole in the other; the smallest screen shows it."""
    light, dark = (COLOUR.sub("", _style_sheet(theme)) for theme in (LIGHT, DARK))
    assert light == dark


@pytest.mark.parametrize(
    ("choice", "sizes"), [(ThemeChoice.LIGHT, SIZES), (ThemeChoice.DARK, SIZES[:1])]
)
def test_no_text_is_cut_off(
    disconnected: SharedWindow,
    session: Path,
    tmp_path: Path,
    choice: ThemeChoice,
    sizes: Sequence[tuple[int, int]],
) -> None:
    window, finger = disconnected.window, FakeFinger(tmp_path)
    disconnected.finger = finger
    before = window.size()
    assert disconnected.engine is not None
    stage = Stage(window, disconnected.engine, finger, session)
    window.set_theme(choice)
    try:
        found = _measure(stage, scenes(stage), sizes)
    finally:
        _leave_finger(window)
        window.set_theme(ThemeChoice.LIGHT)
        window.resize(before)
    assert not found, "\n".join(found)


@pytest.mark.parametrize("percent", TEXT_SIZES_PERCENT[2:])
def test_no_larger_text_is_cut_off_on_a_small_screen(
    disconnected: SharedWindow, session: Path, tmp_path: Path, percent: int
) -> None:
    window = disconnected.window
    before = window.size()
    assert disconnected.engine is not None
    disconnected.finger = FakeFinger(tmp_path)
    stage = Stage(window, disconnected.engine, disconnected.finger, session)
    window.set_text_size(percent)
    try:
        found = _measure(stage, scenes(stage), SIZES[:1])
    finally:
        _leave_finger(window)
        window.set_text_size(100)
        window.resize(before)
    assert not found, "\n".join(found)
