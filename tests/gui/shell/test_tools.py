"""The Tools menu: accept a rig and list the serial ports, with the words of the command line."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.shell.tools_controller import IN_USE
from rigctl import cli
from tests.analysis.recordings import record
from tests.gui.steps import Harness, SharedWindow, click, wait_until


def _choose(window: SharedWindow, text: str) -> None:
    """Choose an action of the Tools menu by its text."""
    for menu in window.window.menuBar().actions():
        submenu = menu.menu()
        for action in submenu.actions() if submenu is not None else ():
            if action.text() == text:
                action.trigger()
                return
    raise AssertionError(f"no action {text}")


def _printed(*words: str) -> str:
    """Return what the command line prints, with its errors."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        cli.main([*words])
    return out.getvalue().strip()


def test_accept_prints_the_words_of_the_command_line(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    window, page = disconnected.window, disconnected.window.tools.accept_page
    session = record(tmp_path / "session", textures="A")
    _choose(disconnected, "&Accept a rig")
    assert window.stack.currentWidget() is page
    page.folder.clear()
    click(page.run_button)
    assert page.verdict.text() == "Choose the folder of a session first."
    page.folder.setFocus()
    QTest.keyClicks(page.folder, str(session))
    QTest.keyClick(page.folder, Qt.Key.Key_Return)
    assert page.is_running and not page.run_button.isEnabled()
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    printed = _printed("accept", str(session))
    assert page.output.toPlainText().strip() == printed
    assert page.verdict.text() == printed.splitlines()[-1]
    click(page.close_button)
    assert window.stack.currentWidget() is window.live_page


def test_a_folder_without_a_session_is_refused_in_a_sentence(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    page = disconnected.window.tools.accept_page
    _choose(disconnected, "&Accept a rig")
    page.folder.setText(str(tmp_path / "none"))
    click(page.run_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    assert str(tmp_path / "none") in page.verdict.text()
    assert "Traceback" not in page.output.toPlainText()


def test_a_command_can_be_cancelled_and_started_again(disconnected: SharedWindow) -> None:
    page = disconnected.window.tools.ports_page
    _choose(disconnected, "&Serial ports")
    click(page.run_button)
    click(page.cancel_button)
    assert page.verdict.text() == "Cancelled." and page.run_button.isEnabled()
    click(page.run_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    assert "port" in page.verdict.text()


@pytest.mark.parametrize("simulated", [True, False])
def test_boards_in_use_are_not_reset(harness: Harness, simulated: bool) -> None:
    page = harness.window.tools.ports_page
    harness.update(simulated=simulated)
    click(page.run_button)
    assert (page.verdict.text() == IN_USE) is not simulated
    page.cancel()
