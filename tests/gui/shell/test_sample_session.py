"""The sample session: made from the start page, used again, cancelled, refused in a sentence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.shell.main_window import MainWindow
from gui.shell.start_page import CANCELLED, READY, REMEDY, SAMPLE
from rigctl.session.session import open_session
from rigctl.session.verify import verify
from rigctl.synth import sample_session
from rigctl.synth.sample_session import CHECKING, MAKING, SYNTH, sample_folder
from tests.gui.full_disk import full_disk
from tests.gui.steps import SharedWindow, click, own_window, wait_until

TIMEOUT_MS = 300_000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where the sample session of a user without one will be."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    return sample_folder()


@pytest.fixture
def slow_making(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the command take minutes."""
    monkeypatch.setattr(sample_session, "SYNTH", (*SYNTH, "--repeats", "200"))


@pytest.fixture
def window(disconnected: SharedWindow, folder: Path) -> Iterator[MainWindow]:
    """Yield the shared window with the start page in the middle."""
    window = disconnected.window
    window.show_panel("operate")
    window.start.show_page()
    yield window
    wait_until(lambda: not window.analysis_tab.reader.is_busy, TIMEOUT_MS)
    window.analysis_tab.panel.show_unopened("No session is open.")
    window.show_panel("operate")
    click(window.start.back)


def _choose_in_menu(window: MainWindow) -> None:
    text = SAMPLE.replace("sample", "&sample")
    next(a for m, a in window.menus.actions() if m == "File" and a.text() == text).trigger()


def _wait_until_opened(window: MainWindow, folder: Path) -> None:
    """Wait until the session and its first trial stand in the panel Analysis."""
    tab = window.analysis_tab
    wait_until(lambda: tab.panel.path == str(folder) and not tab.reader.is_busy, TIMEOUT_MS)


def _half_make(folder: Path) -> None:
    """Leave what a damaged sample, and a window that was killed, leave."""
    for left in (folder, folder.with_name(f"{folder.name}.partial")):
        left.mkdir(parents=True)
        (left / "part-0001.h5").write_text("no HDF5")


def test_the_sample_is_made_whole_opened_and_used_again(window: MainWindow, folder: Path) -> None:
    page, told = window.start, dict[str, list[str]]()
    _half_make(folder)
    listening = window.start.maker.told.connect(
        lambda stage, line: told.setdefault(stage, []).append(line)
    )
    click(page.sample)
    assert page.sample_box.text.text().startswith(CHECKING)
    _wait_until_opened(window, folder)
    window.start.maker.disconnect(listening)
    assert list(told) == [CHECKING, MAKING] and any(" left" in line for line in told[MAKING])
    assert not page.isVisible() and window.docks.docks["analysis"].isVisible()
    assert "simulated rig" in window.analysis_tab.panel.about.text()
    assert "sample-session-damaged-1" in window.event_log.toPlainText()
    names = {path.name for path in folder.parent.iterdir()}
    assert names == {folder.name, "sample-session-damaged-1"}
    assert verify(folder).whole
    place = window.analysis_tab.panel.run_box.place_of(str(folder))
    assert str(place) == window.protocol_panel.out.text(), "no results in a hidden folder"
    assert window.settings.recent("sessions")[0] == str(folder)
    with open_session(folder) as session:
        assert session.header.simulated and len(session.committed()) == 32

    made_ns = (folder / "part-0001.h5").stat().st_mtime_ns
    window.analysis_tab.panel.show_unopened("No session is open.")
    _choose_in_menu(window)
    assert page.isVisible()
    _wait_until_opened(window, folder)
    assert (folder / "part-0001.h5").stat().st_mtime_ns == made_ns

    _choose_in_menu(window)
    click(page.back)  # the user goes on to something else
    wait_until(lambda: READY in window.event_log.toPlainText(), TIMEOUT_MS)
    assert not page.isVisible() and page.sample.isEnabled()


@pytest.mark.usefixtures("slow_making")
def test_a_second_press_makes_no_second_one_and_cancel_leaves_nothing(
    window: MainWindow, folder: Path
) -> None:
    page = window.start
    page.sample.setFocus()
    QTest.keyClick(page.sample, Qt.Key.Key_Space)
    click(page.sample)
    _choose_in_menu(window)
    partial = folder.with_name(f"{folder.name}.partial")
    wait_until(lambda: (partial / "part-0001.h5").exists(), TIMEOUT_MS)
    assert [path for path in folder.parent.iterdir() if path.is_dir()] == [partial]
    wait_until(lambda: page.sample_box.text.text().startswith(MAKING))
    click(page.sample_box.cancel_button)
    wait_until(lambda: page.sample_box.text.text() == CANCELLED)
    assert list(folder.parent.iterdir()) == []
    assert page.sample.isEnabled() and not page.sample_box.cancel_button.isVisible()


@pytest.mark.usefixtures("slow_making")
def test_a_window_that_closes_ends_the_making(qapp: QApplication, folder: Path) -> None:
    with own_window() as window:
        window.show()
        window.start.show_page()
        click(window.start.sample)
        partial = folder.with_name(f"{folder.name}.partial")
        wait_until(lambda: (partial / "part-0001.h5").exists(), TIMEOUT_MS)
        window.close()
        assert list(folder.parent.iterdir()) == []
        QApplication.processEvents()
        assert not window.analysis_tab.panel.path


def test_a_failure_is_a_sentence_in_place_with_a_remedy(window: MainWindow, folder: Path) -> None:
    page, box = window.start, window.start.sample_box
    with full_disk(200_000):
        click(page.sample)
        wait_until(lambda: page.sample.isEnabled(), TIMEOUT_MS)
    # The record or the simulated world's log meets the limit first: they grow beside each other.
    assert re.search(
        r"\(file size limit\): lift it|\(File too large\).* make room", box.text.text()
    )
    assert box.text.property("role") == "bad"
    assert box.remedy.isVisible() and box.remedy.text() == REMEDY
    assert list(folder.parent.iterdir()) == []

    folder.parent.rmdir()
    folder.parent.write_text("a file where the folder should be")
    click(page.sample)
    wait_until(lambda: str(folder.parent) in box.text.text())
    assert "allow writing" in box.text.text()
    assert "the sample session was not made" in window.event_log.toPlainText()
    click(page.back)
    window.start.show_page()
    assert not box.isVisible()  # a sentence does not outlive the visit
