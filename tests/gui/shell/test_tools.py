"""The Tools menu: accept a rig and list the serial ports, with the words of the command line."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.shell.tools_controller import IN_USE, CommandPage, FieldsPage
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
    folder = page.fields["Session"]
    folder.clear()
    click(page.run_button)
    assert page.verdict.text() == "Session: choose it first."
    folder.setFocus()
    QTest.keyClicks(folder, str(session))
    QTest.keyClick(folder, Qt.Key.Key_Return)
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
    page.fields["Session"].setText(str(tmp_path / "none"))
    click(page.run_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    assert str(tmp_path / "none") in page.verdict.text()
    assert "Traceback" not in page.output.toPlainText()


def run_page(page: CommandPage, **texts: object) -> str:
    """Fill the fields of a page, press its button, and return its verdict at the end."""
    assert isinstance(page, FieldsPage)
    for name, text in texts.items():
        page.fields[name.replace("_", " ")].setText(str(text))
    click(page.run_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    return page.verdict.text()


def test_recordings_are_imported_by_a_guessed_map_and_opened(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    window, page = disconnected.window, disconnected.window.tools.import_page
    rows = ["time,s1,s2", *(f"{n / 1000},{300 + n % 7},{400 + n % 5}" for n in range(2000))]
    recordings = tmp_path / "lab"
    recordings.mkdir()
    (recordings / "felt_40mm_s_250g_1.csv").write_text("\n".join(rows))
    _choose(disconnected, "I&mport recordings")
    assert not page.open_button.isEnabled()
    page.fields["Recordings"].setText("lab")
    click(page.guess_button)
    assert page.verdict.text().startswith("Recordings: give the whole path")
    page.fields["Recordings"].setText(str(recordings))
    page.fields["Map"].setText(str(tmp_path / "map.toml"))
    click(page.guess_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    assert (tmp_path / "map.toml").exists() and "s1" in page.output.toPlainText()
    page.fields["Write into"].setText(str(tmp_path / "imported"))
    click(page.run_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    assert "1 trials of 2 taxels" in page.output.toPlainText()
    click(page.open_button)
    panel = window.analysis_tab.panel
    wait_until(lambda: panel.path == str(tmp_path / "imported"))
    panel.show_unopened("No session is open.")


def test_sessions_are_encoded_exported_and_recovered_from_the_menus(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    tools = disconnected.window.tools
    session = record(tmp_path / "session", textures="A")
    _choose(disconnected, "&Export a session")
    page, table = tools.export_page, tmp_path / "trials.csv"
    page.format.setCurrentIndex(page.format.findData("table"))
    assert run_page(page, Session=session, Write_into="") == "Write into: choose it first."
    assert run_page(page, Session=session, Write_into=table) == str(table)
    assert table.read_text().startswith("trial_id,")
    page.format.setCurrentIndex(page.format.findData("csv"))
    page.trials.setText("1")
    page.representations.setCurrentIndex(page.representations.findData("spikes"))
    tables = tmp_path / "session-csv"
    assert run_page(page, Session=session, Write_into="") == f"export: {tables}"
    assert len((tables / "trials.csv").read_text().splitlines()) == 2
    assert (tables / "spikes.csv").exists() and not (tables / "samples.csv").exists()
    assert "exists already" in run_page(page, Session=session)
    _choose(disconnected, "&Recover a session")
    assert "has no part to close" in run_page(tools.recover_page, Session=session)
    _choose(disconnected, "&Encode a session")
    assert tools.encode_page.run_button.text() == "Encode"
    spikes = tmp_path / "spikes"
    verdict = run_page(tools.encode_page, Session=session, Write_into=spikes)
    assert verdict == f"spikes: {spikes / 'spikes.h5'}"


def test_a_command_can_be_cancelled_and_started_again(disconnected: SharedWindow) -> None:
    page = disconnected.window.tools.ports_page
    _choose(disconnected, "&Serial ports")
    click(page.run_button)
    click(page.cancel_button)
    assert page.verdict.text() == "Cancelled." and page.run_button.isEnabled()
    click(page.run_button)
    wait_until(lambda: not page.is_running, timeout_ms=120_000)
    assert "port" in page.verdict.text()


def test_a_cancelled_export_leaves_nothing(disconnected: SharedWindow, tmp_path: Path) -> None:
    page = disconnected.window.tools.export_page
    session = record(tmp_path / "session", repeats=20)
    _choose(disconnected, "&Export a session")
    page.format.setCurrentIndex(page.format.findData("nwb"))
    page.fields["Session"].setText(str(session))
    page.fields["Write into"].setText(str(tmp_path / "cancelled.nwb"))
    click(page.run_button)
    wait_until((tmp_path / "cancelled.nwb.partial").exists, timeout_ms=120_000)
    click(page.cancel_button)
    assert page.verdict.text() == "Cancelled."
    wait_until(lambda: not list(tmp_path.glob("cancelled*")), timeout_ms=120_000)


@pytest.mark.parametrize("simulated", [True, False])
def test_boards_in_use_are_not_reset(harness: Harness, simulated: bool) -> None:
    page = harness.window.tools.ports_page
    harness.update(simulated=simulated)
    click(page.run_button)
    assert (page.verdict.text() == IN_USE) is not simulated
    page.cancel()
