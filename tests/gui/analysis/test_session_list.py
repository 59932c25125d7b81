"""The list of sessions: what it says of each, its filter, and what its buttons do."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.analysis.overlay_view import LOOKS
from gui.analysis.session_list import BATCH, SessionList
from gui.shell.main_window import MainWindow
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.session import Session, add_note
from rigctl.values import SessionLine
from tests.analysis.recordings import record
from tests.gui.steps import Harness, SharedWindow, click, wait_until
from tests.session.building import SyntheticRig, plan, recorder

pytestmark = pytest.mark.usefixtures("leave_nothing")
NO_KEY, CONTROL = Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ControlModifier
KIND = {"travel_mm": 12.0, "speeds": (40, 80), "forces": (250,)}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a whole session, one with a bad trial, one cut short, one damaged."""
    folder = tmp_path_factory.mktemp("data")
    whole = record(folder / "project" / "whole", "AB", **KIND)
    marked = Path(shutil.copytree(whole, folder / "marked"))
    add_note(marked, SessionNote("2026-11-24T09:00:00Z", "it slipped", 2, 1, Mark.BAD))
    with recorder(folder / "stopped") as rec:
        rec.begin_part("start", "A")
        SyntheticRig(rec).trial(plan().trials[0])
    (folder / "damaged").mkdir()
    part = (whole / "part-0001.h5").read_bytes()
    (folder / "damaged" / "part-0001.h5").write_bytes(part[:3000])
    (folder / "no session").mkdir()
    return folder


@pytest.fixture
def sessions(harness: Harness, data: Path) -> Iterator[SessionList]:
    """Yield the list of that folder, opened by the menu."""
    window = harness.window
    window.protocol_panel.out.setText(str(data))
    listed = window.analysis_tab.sessions
    menu_line(window, "Sess&ions")
    wait_until(lambda: len(listed.lines) == 4 and "being read" not in listed.count.text())
    assert window.stack.currentWidget() is listed
    yield listed
    pages = window.analysis_tab.trial_view
    pages.setCurrentIndex(0)
    pages.compare.show_grid(None)
    window.analysis_tab.panel.trials.filter.clear()
    listed.filter.clear()
    click(listed.close_button)


def menu_line(window: MainWindow, text: str) -> None:
    """Choose a line of the File menu."""
    actions = window.menus.actions()
    next(action for menu, action in actions if menu == "File" and action.text() == text).trigger()


def cells(listed: SessionList, name: str) -> dict[str, str]:
    """Return what a column says of each session that is shown."""
    names = [column.name for column in listed.model.table.columns]
    rows = range(listed.model.rowCount())
    texts = [[listed.model.index(row, names.index(n)).data() for row in rows] for n in (NAME, name)]
    return dict(zip(*texts, strict=True))


NAME = "Session"


def choose(listed: SessionList, name: str, *others: str) -> None:
    """Click on the row of a session, and with Ctrl on others."""
    for keys, one in zip((NO_KEY, *[CONTROL] * len(others)), (name, *others), strict=True):
        row = list(cells(listed, NAME)).index(one)
        at = listed.table.visualRect(listed.model.index(row, 1)).center()
        QTest.mouseClick(listed.table.viewport(), Qt.MouseButton.LeftButton, keys, at)


def test_each_session_says_how_far_it_is(sessions: SessionList) -> None:
    assert cells(sessions, "Trials") == {
        "whole": "4 of 4",
        "marked": "3 of 4",
        "stopped": "1 of 8",
        "damaged": "–",
    }
    assert cells(sessions, "State") == {
        "whole": "complete",
        "marked": "incomplete",
        "stopped": "incomplete",
        "damaged": "unreadable",
    }
    assert cells(sessions, "Bad") == {"whole": "0", "marked": "1", "stopped": "0", "damaged": "0"}
    assert cells(sessions, "Operator")["stopped"] == "Jörg"
    assert all("simulated" in text for name, text in cells(sessions, "Rig").items() if text != "")
    choose(sessions, "damaged")
    assert "is damaged" in sessions.reason.text()
    assert not any(button.isEnabled() for button in sessions.buttons.values())


def test_words_find_sessions_and_columns_sort_them(sessions: SessionList) -> None:
    QTest.keyClicks(sessions.filter, "incomplete small")
    assert list(cells(sessions, NAME)) == ["stopped"]
    assert sessions.count.text() == "1 of 4 sessions"
    sessions.filter.clear()
    sessions.table.sortByColumn(1, Qt.SortOrder.AscendingOrder)
    assert list(cells(sessions, NAME)) == ["damaged", "marked", "stopped", "whole"]
    sessions.table.sortByColumn(-1, Qt.SortOrder.AscendingOrder)


def test_analyse_and_add_open_sessions_beside_each_other(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    panel = harness.window.analysis_tab.panel
    choose(sessions, "whole")
    click(sessions.buttons["Analyse"])
    wait_until(lambda: panel.model.rowCount() == 4)
    menu_line(harness.window, "Sess&ions")
    choose(sessions, "marked")
    click(sessions.buttons["Add"])
    wait_until(lambda: panel.model.rowCount() == 8)
    assert list(panel.sessions) == [str(data / "project" / "whole"), str(data / "marked")]


def test_analyse_opens_all_chosen_sessions(harness: Harness, sessions: SessionList) -> None:
    panel = harness.window.analysis_tab.panel
    choose(sessions, "whole", "marked")
    click(sessions.buttons["Analyse"])
    wait_until(lambda: panel.model.rowCount() == 8)
    assert [Path(path).name for path in panel.sessions] == ["marked", "whole"], "as listed"
    assert panel.run_box.form.sessions == tuple(panel.sessions)


def test_lay_over_shows_the_like_of_each_chosen_session_in_one_plot(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    tab = harness.window.analysis_tab
    compare, button = tab.trial_view.compare, sessions.buttons["Lay over"]
    choose(sessions, "whole")
    assert not button.isEnabled() and "two or more" in button.toolTip()
    choose(sessions, "whole", "marked", "stopped")
    click(button)
    wait_until(lambda: compare.overlay is not None and not tab.reader.is_busy)
    assert harness.window.stack.currentWidget().isAncestorOf(compare) and compare.isVisible()
    overlay = compare.overlay
    assert overlay is not None and overlay.neuron == "T_SA-1" and overlay.simulated
    assert overlay.condition == "plate A, 40 mm/s, 250 g", "the one that all have"
    assert overlay.left_out == "" and len(tab.panel.sessions) == 3
    names = [trial.name.partition(",")[0] for trial in overlay.trials]
    assert sorted(names) == ["marked", "stopped", "whole"]
    whole = overlay.trials[names.index("whole")]
    with Session.open(data / "project" / "whole") as session:
        ids = session.trials["trial_id"].tolist()
        samples = session.samples(ids.index(int(whole.name.rpartition(" ")[2])))
    assert np.array_equal(whole.reading, samples[:, 0])
    assert abs(np.median(whole.force_g) - 250) < 5
    assert "SIMULATED data. T_SA-1." in compare.note.text()
    boxes = [box for box in compare.overlaid.legend if box.isVisible()]
    expected = [f"{number} {trial.name}" for number, trial in enumerate(overlay.trials, 1)]
    assert [box.text() for box in boxes] == expected
    boxes[0].click()
    axis = compare.overlaid.plots.plots[2].getAxis("left")
    assert [text for _, text in axis._tickLevels[0]] == ["2", "3"]


def test_another_condition_and_neuron_are_laid_over_from_the_table(
    harness: Harness, sessions: SessionList
) -> None:
    tab = harness.window.analysis_tab
    compare, panel = tab.trial_view.compare, tab.panel
    choose(sessions, "whole", "marked", "stopped")
    click(sessions.buttons["Lay over"])
    wait_until(lambda: compare.overlay is not None and not tab.reader.is_busy)
    panel.trials.filter.setText("B 80mm/s committed")
    panel.table.selectRow(0)
    compare.neuron.setCurrentText("T_RA-4")
    wait_until(lambda: not tab.reader.is_busy)
    click(compare.overlay_button)
    wait_until(lambda: compare.overlay is not None and compare.overlay.neuron == "T_RA-4")
    overlay = compare.overlay
    assert overlay is not None and overlay.condition == "plate B, 80 mm/s, 250 g"
    assert len(overlay.trials) == 2
    assert overlay.left_out == "Sessions or trials without such a neuron or condition: 1."
    assert overlay.left_out in compare.note.text()
    assert compare.overlaid.plots.plots[1].getAxis("left").labelText == "T4<br>(counts)"


def test_curves_differ_in_colour_and_dashes() -> None:
    looks = [(look.light, look.dark, look.dashes) for look in LOOKS]
    assert all(len(set(part)) == len(LOOKS) for part in zip(*looks, strict=True))


def test_a_session_that_was_verified_says_when(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    panel = harness.window.analysis_tab.panel
    choose(sessions, "whole")
    QTest.keyClick(sessions.table, Qt.Key.Key_Return)
    wait_until(lambda: panel.model.rowCount() == 4)
    click(panel.verify_button)
    wait_until(lambda: "whole is whole" in panel.run_box.result.text())
    assert cells(sessions, "Verified")["whole"].startswith("20")
    assert cells(sessions, "Verified")["stopped"] == "–"
    os.utime(data / "project" / "whole" / "part-0001.h5", (4e9, 4e9))
    click(sessions.refresh_button)
    wait_until(lambda: cells(sessions, "Verified")["whole"] == "–")


def test_table_writes_every_attempt_with_its_notes(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    choose(sessions, "marked")
    click(sessions.buttons["Table"])
    wait_until(lambda: "trials.csv" in harness.window.event_log.toPlainText())
    names, *rows = (data / "marked-figures" / "trials.csv").read_text().splitlines()
    assert names.split(",")[-4:] == ["counts", "why_not", "notes", "simulated"]
    assert len(rows) == 4
    assert [row for row in rows if ",no,marked bad: it slipped,marked bad: it slipped,yes" in row]


def test_export_offers_the_formats_for_the_chosen_session(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    choose(sessions, "whole")
    click(sessions.buttons["Export"])
    page = harness.window.tools.export_page
    assert page.isVisible()
    assert page.fields["Session"].text() == str(data / "project" / "whole")


def test_continue_runs_the_remaining_trials(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    choose(sessions, "whole")
    assert not sessions.buttons["Continue"].isEnabled()
    assert sessions.buttons["Continue"].toolTip() == "All planned trials are recorded"
    choose(sessions, "stopped")
    harness.update(drum_connected=False)
    click(sessions.buttons["Continue"])
    assert "connect its rig" in harness.window.event_log.toPlainText()
    harness.update(drum_connected=True, taxels_connected=True)
    menu_line(harness.window, "Sess&ions")
    choose(sessions, "stopped")
    click(sessions.buttons["Continue"])
    (sent,) = [args for command, args in harness.engine.requests if command == "start"]
    assert sent["resume"] == str(data / "stopped")


def test_recent_sessions_are_those_that_opened(
    harness: Harness, sessions: SessionList, data: Path
) -> None:
    window = harness.window
    window.analysis_tab.open_session(str(data / "damaged"))
    wait_until(lambda: "damaged" in window.analysis_tab.panel.about.text())
    window.analysis_tab.open_session(str(data / "marked"))
    wait_until(lambda: window.analysis_tab.panel.path == str(data / "marked"))
    recent = window.settings.recent("sessions")
    assert recent[0] == str(data / "marked") and str(data / "damaged") not in recent


def test_a_large_folder_is_read_a_few_at_a_time(
    disconnected: SharedWindow, data: Path, tmp_path: Path
) -> None:
    window, listed = disconnected.window, disconnected.window.analysis_tab.sessions
    asked: list[str] = []
    for number in range(2 * BATCH + 1):
        folder = tmp_path / f"copy-{number}"
        folder.mkdir()
        os.link(data / "stopped" / "part-0001.h5", folder / "part-0001.h5")
    window.analysis_tab.reader.finished.connect(lambda task, _: asked.append(task))
    listed.folder.setText(str(tmp_path))
    click(listed.refresh_button)
    wait_until(lambda: "read_session_lines" in asked)
    window.analysis_tab.open_session(str(data / "project" / "whole"))
    wait_until(lambda: len(listed.lines) == 2 * BATCH + 1)
    assert asked.count("read_session_lines") == 3
    assert asked.index("open_session") < len(asked) - 1, "what the user wants comes between"
    listed.folder.setText(str(tmp_path / "none"))
    click(listed.refresh_button)
    wait_until(lambda: "choose the folder that holds the sessions" in listed.count.text())


def test_a_long_list_makes_the_cells_of_each_session_once(qapp: QApplication) -> None:
    """All were made anew with every ten that came, and the window stood still meanwhile."""
    listed, asked, batches = SessionList(), [], []
    listed.verified = lambda line: asked.append(line.path) or ""
    listed.task_requested.connect(lambda task, args: batches.append(args["paths"]))
    paths = tuple(f"/data/{number:03d}" for number in range(5 * BATCH))
    listed.show_found(paths)
    while batches:
        lines = tuple(SessionLine(path, "complete", start_utc=path) for path in batches.pop())
        listed.show_lines(lines)
    assert sorted(asked) == list(paths) and listed.model.rowCount() == len(paths)
    assert [line.path for line in listed.lines] == sorted(paths, reverse=True)
    listed.show_verified()
    assert len(asked) == 2 * len(paths), "Verify may have found any of them whole"
