"""The Help menu leads to the documentation and to the reports of crashes."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtCore import QUrl
from PySide6.QtGui import QAction, QDesktopServices
from PySide6.QtWidgets import QApplication, QMenuBar

from gui.shell import help_page
from gui.shell.actions import ActionRegistry
from gui.shell.help_page import HelpPage, shortcut_table
from tests.gui.steps import SharedWindow


def menu_action(bar: QMenuBar, text: str) -> QAction:
    """Return the line of the Help menu with this text."""
    (menu,) = [action.menu() for action in bar.actions() if action.text() == "&Help"]
    (line,) = [line for line in menu.actions() if line.text().replace("&", "") == text]
    return line


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the first page of the documentation, in place of one that a test may rebuild now."""
    page = tmp_path / "README.html"
    page.write_text("")
    monkeypatch.setattr(help_page, "documentation", lambda: page)
    return page


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the files that the desktop is asked to open."""
    paths: list[str] = []
    monkeypatch.setattr(
        QDesktopServices, "openUrl", lambda url: not paths.append(QUrl(url).toLocalFile())
    )
    return paths


def test_crash_reports_open_their_folder_or_are_none(
    qapp: QApplication, tmp_path: Path, opened: list[str]
) -> None:
    bar = QMenuBar()
    help_menu, lines = HelpPage(ActionRegistry(bar), tmp_path), list[tuple[str, str]]()
    help_menu.reported.connect(lambda kind, text: lines.append((kind, text)))
    menu_action(bar, "Crash reports").trigger()
    assert lines == [("help", "there are no crash reports")] and not opened
    (tmp_path / "rigctl-crash-1.txt").write_text("report")
    menu_action(bar, "Crash reports").trigger()
    assert opened == [str(tmp_path)] and lines[-1] == ("opened", f"opened {tmp_path}")


def test_help_says_when_nothing_opened(
    disconnected: SharedWindow, monkeypatch: pytest.MonkeyPatch, page: Path
) -> None:
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: False)
    window = disconnected.window
    menu_action(window.menuBar(), "Documentation").trigger()
    assert f"this desktop has no program to open {page}" in window.event_log.toPlainText()
    page.unlink()
    menu_action(window.menuBar(), "Documentation").trigger()
    assert f"{page} is missing: this installation was packed" in window.event_log.toPlainText()


def test_about_leads_to_the_documentation(
    disconnected: SharedWindow, opened: list[str], page: Path
) -> None:
    window = disconnected.window
    menu_action(window.menuBar(), "About rigctl").trigger()
    assert QUrl.fromLocalFile(str(page)).toString() in window.help.text.toHtml()
    menu_action(window.menuBar(), "Documentation").trigger()
    assert opened == [str(page)]
    assert f"opened {page}" in window.event_log.toPlainText()
    window.show_panel("operate")


def test_the_shortcut_sheet_lists_the_keys_of_the_results() -> None:
    table = shortcut_table(())
    for action in ("Choose components", "Choose a curve", "Choose a cell", "Zoom"):
        assert f"<td>{action}</td>" in table
    assert "<td>Accuracy, Confusion</td>" in table
