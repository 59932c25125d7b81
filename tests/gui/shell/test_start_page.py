"""The start page: there at the first start only, gone once something is connected or opened."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication, QLabel

from gui.shell.main_window import MainWindow
from gui.shell.start_page import PANELS
from gui.shell.user_settings import UserSettings
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import Harness, SharedWindow, click, own_window, wait_until


@pytest.fixture
def first(qapp: QApplication, engine: FakeEngine, tmp_path: Path) -> Iterator[MainWindow]:
    """Yield a window whose user has no settings yet."""
    with own_window(engine, UserSettings(tmp_path / "window.ini")) as window:
        window.show()
        QApplication.processEvents()
        yield window


def test_virtual_rig_starts_from_the_page_and_hides_it(first: MainWindow) -> None:
    page = first.start
    wait_until(page.isVisible)
    texts = {label.text() for label in page.findChildren(QLabel) if label.isVisible()}
    assert set(PANELS) | set(PANELS.values()) <= texts
    assert {"Operate", "Protocol", "Analysis", "Finger"} <= set(PANELS)
    click(page.virtual)
    wait_until(lambda: first.engine_link.live is not None)
    assert first.stack.currentWidget() is first.live_page
    assert first.toolbar.rig.currentData() == "virtual"


def test_opening_a_session_hides_the_page(first: MainWindow) -> None:
    wait_until(first.start.isVisible)
    click(first.start.session)
    assert first.file_browser.isVisible()
    first.file_browser.dismiss()
    assert not first.start.isVisible()


def test_page_is_there_at_the_first_start_only(
    first: MainWindow, engine: FakeEngine, tmp_path: Path
) -> None:
    first.memory.save()
    with own_window(engine, UserSettings(tmp_path / "window.ini")) as again:
        again.show()
        QApplication.processEvents()
        assert not again.start.isVisible()


def test_help_menu_shows_the_page_again(disconnected: SharedWindow) -> None:
    window = disconnected.window
    page = window.start
    assert not page.isVisible()
    actions = window.menuBar().actions()[-1].menu().actions()
    next(action for action in actions if action.text() == "S&tart page").trigger()
    assert page.isVisible()
    click(page.back)
    assert window.stack.currentWidget() is window.live_page


def test_virtual_rig_never_replaces_a_connected_one(harness: Harness) -> None:
    window, client = harness.window, harness.window.engine_link.live
    window.start.show_page()
    click(window.start.virtual)
    assert "disconnect it first" in window.event_log.toPlainText()
    assert window.engine_link.live is client
    click(window.start.back)
