"""The table of trials sorts, filters, joins sessions, follows a recording and gives reasons."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.analysis.analysis_tab import AnalysisTab
from gui.analysis.trial_list import TrialList
from gui.analysis.trial_table import AttemptColumn, join_tables
from gui.widgets.theme import LIGHT
from rigctl.session.layout import SAMPLES
from rigctl.session.notes import Mark, SessionNote, read_notes
from rigctl.session.session import Session, add_note
from rigctl.values import TrialMark, Verdict
from tests.analysis.recordings import record
from tests.gui.steps import Harness, SharedWindow, click, wait_until
from tests.session.block_session import record_in_blocks
from tests.session.building import SyntheticRig, plan, record_repeats, recorder
from tests.session.damage import zero

pytestmark = pytest.mark.usefixtures("leave_nothing")


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return two sessions of four trials each."""
    folder = tmp_path_factory.mktemp("table")
    kind = {"travel_mm": 12.0, "speeds": (40, 80), "forces": (250,)}
    return record(folder / "one", "AB", **kind), record(folder / "two", "DL", seed=4, **kind)


@pytest.fixture
def analysis(harness: Harness) -> Iterator[Harness]:
    """Yield the window on the Analysis tab, without a filter afterwards."""
    harness.window.show_panel("analysis")
    yield harness
    trials = harness.window.analysis_tab.panel.trials
    trials.filter.clear()
    trials.table.sortByColumn(-1, Qt.SortOrder.AscendingOrder)


def open_session(harness: Harness, path: Path) -> None:
    """Open a session from code, as the end of a run does."""
    harness.window.analysis_tab.open_session(str(path))
    wait_until(lambda: not harness.window.analysis_tab.reader.is_busy)


def column(trials: TrialList, name: str) -> list[str]:
    """Return the texts that a column shows."""
    at = [one.name for one in trials.model.table.columns].index(name)
    return [trials.model.index(row, at).data() for row in range(trials.model.rowCount())]


def click_header(trials: TrialList, name: str) -> None:
    """Click on a column's name."""
    header = trials.table.horizontalHeader()
    at = [one.name for one in trials.model.table.columns].index(name)
    trials.table.scrollTo(trials.model.index(0, at))
    place = header.sectionViewportPosition(at) + header.sectionSize(at) // 2
    at_name = QPoint(place, header.height() // 2)
    QTest.mouseClick(header.viewport(), Qt.MouseButton.LeftButton, pos=at_name)


def test_a_click_sorts_and_words_filter(analysis: Harness, sessions: tuple[Path, Path]) -> None:
    open_session(analysis, sessions[0])
    tab = analysis.window.analysis_tab
    trials = tab.panel.trials
    click_header(trials, "mm/s")
    assert column(trials, "mm/s") == ["40", "40", "80", "80"]
    click_header(trials, "mm/s")
    assert column(trials, "mm/s") == ["80", "80", "40", "40"]
    QTest.keyClicks(trials.filter, "B 40mm/s")
    assert column(trials, "Plate") == ["B"] and column(trials, "mm/s") == ["40"]
    assert trials.count.text() == "1 of 4 attempts"
    trials.table.selectRow(0)
    wait_until(lambda: "plate B, 40 mm/s" in title(tab.trial_view.data))
    trials.filter.clear()
    assert trials.model.rowCount() == 4 and trials.count.text() == "4 attempts"


def test_keys_alone_sort_and_filter(analysis: Harness, sessions: tuple[Path, Path]) -> None:
    window = analysis.window
    open_session(analysis, sessions[0])
    trials = window.analysis_tab.panel.trials
    table, header = trials.table, trials.table.header
    window.activateWindow()
    wait_until(window.isActiveWindow)
    window.show_panel("operate")
    control, shift = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
    QTest.keyClick(window, Qt.Key.Key_S, control | shift)
    wait_until(header.hasFocus)
    QTest.keyClick(header, Qt.Key.Key_Home)
    for _ in range(2):
        QTest.keyClick(header, Qt.Key.Key_Right)
    orders = (["40", "40", "80", "80"], ["80", "80", "40", "40"], ["40", "80", "40", "80"])
    keys = (Qt.Key.Key_Return, Qt.Key.Key_Space, Qt.Key.Key_Enter)
    for key, speeds in zip(keys, orders, strict=True):
        QTest.keyClick(header, key)
        assert column(trials, "mm/s") == speeds
        assert header.sortIndicatorSection() == (-1 if speeds == orders[2] else 2)
    assert header.accessibleDescription() == "mm/s; sorted by recording"
    QTest.keyClick(header, Qt.Key.Key_End)
    end = header.sectionViewportPosition(header.column) + header.sectionSize(header.column)
    assert header.column == header.count() - 1 and end <= header.viewport().width()
    QTest.keyClick(header, Qt.Key.Key_Return)
    assert header.isSortIndicatorShown() and header.sortIndicatorSection() == header.column
    assert header.accessibleDescription() == "Why; sorted by Why rising"

    QTest.keyClick(header, Qt.Key.Key_Down)
    assert table.hasFocus()
    QTest.keyClicks(table, "B")
    assert trials.filter.hasFocus() and trials.filter.text() == "B"
    QTest.keyClicks(trials.filter, " 40mm/s")
    assert column(trials, "Plate") == ["B"]
    QTest.keyClick(trials.filter, Qt.Key.Key_Return)
    assert table.hasFocus()
    QTest.keyClick(table, Qt.Key.Key_Down)
    for key, focus in ((Qt.Key.Key_Up, header), (Qt.Key.Key_Down, table)):
        QTest.keyClick(QApplication.focusWidget(), key)
        assert focus.hasFocus()
    window.show_panel("operate")
    QTest.keyClick(window, Qt.Key.Key_F, control)
    wait_until(trials.filter.hasFocus)
    QTest.keyClick(trials.filter, Qt.Key.Key_Delete)
    assert trials.model.rowCount() == 4


def title(data: object) -> str:
    """Return the title of the trial that is shown, empty without one."""
    return getattr(data, "title", "")


def test_several_sessions_are_one_table(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    open_session(analysis, sessions[0])
    tab = analysis.window.analysis_tab
    panel, form = tab.panel, tab.panel.run_box.form
    form.add_session(str(sessions[1]))
    wait_until(lambda: panel.model.rowCount() == 8)
    assert column(panel.trials, "Session") == ["one"] * 4 + ["two"] * 4
    assert "two: 4 of 4 trials committed" in panel.about.text()
    QTest.keyClicks(panel.trials.filter, "two L 80mm/s")
    assert panel.model.rowCount() == 1
    panel.table.selectRow(0)
    wait_until(lambda: "plate L, 80 mm/s" in title(tab.trial_view.data))
    panel.trials.filter.clear()
    form.add_session(str(tmp_path))
    wait_until(lambda: f"{tmp_path} is not a session" in panel.run_box.result.text())
    assert panel.model.rowCount() == 8 and len(form.sessions) == 2
    click(form.remove_button)
    assert panel.model.rowCount() == 4 and form.sessions == (str(sessions[0]),)


def test_a_session_that_is_recorded_is_followed(analysis: Harness, tmp_path: Path) -> None:
    of, folder = plan(), tmp_path / "growing"
    tab = analysis.window.analysis_tab
    panel = tab.panel
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        source = SyntheticRig(rec)
        source.trial(of.trials[0])
        rec.wait_written()
        open_session(analysis, folder)
        assert panel.model.rowCount() == 1 and "It is being recorded" in panel.about.text()
        source.trial(of.trials[1], Verdict.ABORTED)
        source.trial(of.trials[2])
        rec.wait_written()
        wait_until(lambda: panel.model.rowCount() == 3)
        assert panel.table.currentIndex().row() == 0, "the chosen trial stays"
        assert not panel.trials.reason.isVisible()
        panel.table.selectRow(1)
        assert panel.trials.reason.text().startswith("⚠ Trial ")
        assert "was aborted: 2 samples lost; force off" in panel.trials.reason.text()
        wait_until(lambda: "aborted" in title(tab.trial_view.data))
    wait_until(lambda: not panel.growing)
    assert "It is being recorded" not in panel.about.text()
    assert len(panel.digest.text()) == 64
    assert column(panel.trials, "Why")[1] == "2 samples lost; force off"


def test_a_trial_that_was_marked_bad_is_left_out_and_says_why(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(sessions[0], tmp_path / "marked"))
    add_note(folder, SessionNote("2026-11-24T09:00:00Z", "it slipped", 2, 1, Mark.BAD))
    open_session(analysis, folder)
    panel = analysis.window.analysis_tab.panel
    row = column(panel.trials, "Trial").index("2")
    expected = ["left out" if number == row else "committed" for number in range(4)]
    assert column(panel.trials, "Verdict") == expected
    assert "it slipped" in column(panel.trials, "Why")[row]
    panel.table.selectRow(row)
    assert panel.trials.reason.text().startswith("⚠ Trial 2 is left out: marked bad")
    panel.trials.filter.setText("left")
    assert panel.model.rowCount() == 1


def test_a_trial_that_was_repeated_is_not_called_left_out(
    analysis: Harness, tmp_path: Path
) -> None:
    record_repeats(tmp_path / "repeats")
    open_session(analysis, tmp_path / "repeats")
    panel = analysis.window.analysis_tab.panel
    verdicts = column(panel.trials, "Verdict")
    assert verdicts[:4] == ["rejected, repeated", "committed", "repeated", "committed"]
    assert "left out" not in panel.about.text()
    panel.table.selectRow(2)
    assert panel.trials.reason.text().startswith("⚠ Trial 2 was repeated: marked bad: slipped")
    panel.table.selectRow(0)
    assert panel.trials.reason.text().startswith("⚠ Trial 1 was rejected and repeated: ")


def test_a_note_on_a_trial_stands_in_the_table_and_on_its_plots(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(sessions[0], tmp_path / "noted"))
    open_session(analysis, folder)
    tab = analysis.window.analysis_tab
    panel, box = tab.panel, tab.panel.note_box
    wait_until(lambda: tab.trial_view.data is not None)
    assert not box.add_button.isEnabled()
    panel.table.selectRow(1)
    QTest.keyClicks(box.text, "a squeak")
    click(box.add_button)
    wait_until(lambda: column(panel.trials, "Notes") == ["", "a squeak", "", ""])
    wait_until(lambda: [m.text for m in marks(tab)] == ["a squeak"])
    for plot in (tab.trial_view.readings.samples_plot, tab.trial_view.course.force_plot):
        lines = [item for item in plot.items if isinstance(item, pg.InfiniteLine)]
        assert any(line.toolTip() == "a squeak" for line in lines)


def marks(tab: AnalysisTab) -> tuple[TrialMark, ...]:
    """Return the notes of the trial that is shown."""
    return tab.trial_view.data.marks if tab.trial_view.data is not None else ()


def test_one_key_marks_a_trial_bad_and_good_again(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(sessions[0], tmp_path / "keyed"))
    open_session(analysis, folder)
    window, panel = analysis.window, analysis.window.analysis_tab.panel
    window.activateWindow()
    wait_until(window.isActiveWindow)
    panel.table.selectRow(2)
    for verdict in ("left out", "committed"):
        QTest.keyClick(panel.table, Qt.Key.Key_B, Qt.KeyboardModifier.ControlModifier)
        wait_until(lambda verdict=verdict: column(panel.trials, "Verdict")[2] == verdict)
    notes = [(note.trial_id, note.mark, note.text) for note in read_notes(folder)]
    assert notes == [(3, Mark.BAD, "no reason given"), (3, Mark.GOOD, "no reason given")]


def test_the_reader_starts_with_the_window_and_only_once(
    disconnected: SharedWindow, sessions: tuple[Path, Path]
) -> None:
    tab = disconnected.window.analysis_tab
    tab.prepare()
    tab.prepare()
    wait_until(lambda: not tab.reader.is_busy)
    disconnected.window.show_panel("analysis")
    tab.panel.folder.setText(str(sessions[0]))
    click(tab.panel.open_button)
    wait_until(lambda: tab.panel.model.rowCount() == 4)
    wait_until(lambda: tab.trial_view.data is not None)


def test_a_session_that_is_wanted_at_once_opens_before_the_encoder_is_loaded(
    qapp: QApplication, sessions: tuple[Path, Path]
) -> None:
    tab, done = AnalysisTab(LIGHT), list[str]()
    tab.reader.finished.connect(lambda task, result: done.append(task))
    tab.prepare()
    tab.panel.open_session(str(sessions[0]))

    wait_until(lambda: tab.panel.model.rowCount() == 4)
    tab.close()
    assert done == ["prepare", "open_session"]


def test_verify_is_in_the_window_with_the_words_of_the_command(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    open_session(analysis, sessions[0])
    tab = analysis.window.analysis_tab
    panel, box = tab.panel, tab.panel.run_box
    click(panel.verify_button)
    assert box.cancel_button.isEnabled() and not panel.verify_button.isEnabled()
    wait_until(lambda: "one is whole: 4 trials committed" in box.result.text())
    assert analysis.window.stack.currentWidget() is tab.results_panel
    QTest.keyClicks(panel.kept, "12")
    click(panel.verify_button)
    wait_until(lambda: "is not a digest" in box.result.text())
    panel.kept.clear()
    QTest.keyClicks(panel.kept, "0" * 64)
    click(panel.verify_button)
    wait_until(lambda: "one is not whole, 1 problem" in box.result.text())
    assert panel.verify_button.isEnabled() and not box.cancel_button.isEnabled()
    click(panel.verify_button)
    click(box.cancel_button)
    assert panel.verify_button.isEnabled() and not tab.worker.is_busy


def flip_sample_of_trial(folder: Path, row: int) -> None:
    """Flip a bit in a sample of an attempt."""
    with Session.open(folder) as session:
        trial = session.trials[row]
        part, at = int(trial["part"]), int(trial["first_sample"]) + 20
    with h5py.File(folder / f"part-{part:04d}.h5", "r+") as file:
        file[SAMPLES][at, 0] ^= 1


def test_verify_marks_altered_trials_in_the_table(analysis: Harness, tmp_path: Path) -> None:
    folder = tmp_path / "altered"
    record_in_blocks(folder)
    flip_sample_of_trial(folder, 5)
    open_session(analysis, folder)
    panel = analysis.window.analysis_tab.panel
    assert "left out" not in column(panel.trials, "Verdict")
    click(panel.verify_button)
    wait_until(lambda: "is not whole" in panel.run_box.result.text())
    assert panel.run_box.result.property("role") == "bad"
    wait_until(lambda: "left out" in column(panel.trials, "Verdict"))
    verdicts = column(panel.trials, "Verdict")
    assert [place for place, text in enumerate(verdicts) if text == "left out"] == [5]
    panel.trials.table.selectRow(5)
    assert "is left out: " in panel.trials.reason.text()


def test_verify_checks_all_open_sessions_and_shows_the_one_that_is_not_whole(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "altered"
    record_in_blocks(folder)
    flip_sample_of_trial(folder, 5)
    open_session(analysis, folder)
    tab = analysis.window.analysis_tab
    tab.panel.run_box.form.add_session(str(sessions[0]))
    wait_until(lambda: list(tab.panel.sessions) == [str(folder), str(sessions[0])])
    analysis.window.event_log.clear()
    click(tab.panel.verify_button)
    log = analysis.window.event_log
    wait_until(lambda: "one is whole: 4 trials committed" in log.toPlainText())
    assert "altered is not whole" in log.toPlainText()
    assert "is not whole" in tab.panel.run_box.result.text()
    wait_until(lambda: not tab.worker.is_busy and not tab.reader.is_busy)


def test_a_check_that_ends_late_brings_no_other_session_back(
    analysis: Harness, sessions: tuple[Path, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "altered"
    record_in_blocks(folder)
    flip_sample_of_trial(folder, 5)
    tab = analysis.window.analysis_tab
    open_session(analysis, folder)
    wait_until(lambda: str(folder) in tab.panel.sessions)
    click(tab.panel.verify_button)
    open_session(analysis, sessions[0])
    wait_until(lambda: list(tab.panel.sessions) == [str(sessions[0])])
    wait_until(lambda: "is not whole" in tab.panel.run_box.result.text())
    wait_until(lambda: not tab.reader.is_busy)
    assert list(tab.panel.sessions) == [str(sessions[0])]


def test_a_trial_is_shown_while_an_analysis_runs(
    analysis: Harness, sessions: tuple[Path, Path]
) -> None:
    open_session(analysis, sessions[0])
    tab = analysis.window.analysis_tab
    click(tab.panel.run_box.run_button)
    tab.panel.table.selectRow(3)
    wait_until(lambda: title(tab.trial_view.data).startswith("Trial 4"))
    wait_until(lambda: not tab.worker.is_busy)


def test_a_session_that_vanished_is_said_in_a_sentence(analysis: Harness, tmp_path: Path) -> None:
    session = record(tmp_path / "gone", "AB", travel_mm=12.0, speeds=(40,), forces=(250,))
    for part in session.glob("part-*.h5"):
        zero(part)
    open_session(analysis, session)
    panel = analysis.window.analysis_tab.panel
    assert "is damaged" in panel.about.text() and panel.model.rowCount() == 0
    assert not panel.verify_button.isEnabled()


def test_many_trials_are_sorted_and_filtered_by_any_column() -> None:
    n = 24_000
    plates = np.array(["A", "B", "L"])[np.arange(n) % 3]
    columns = (
        AttemptColumn("Trial", np.arange(1, n + 1)),
        AttemptColumn.of_texts("Plate", plates),
        AttemptColumn("g", np.where(np.arange(n) % 2, 250.0, np.nan)),
        AttemptColumn.of_texts("Verdict", np.where(np.arange(n) % 5, "committed", "aborted")),
    )
    table = join_tables(["one"], [columns])
    assert table.matching("A").sum() == n // 3, "a plate is not the beginning of a verdict"
    assert table.matching("abort").sum() == n // 5
    assert table.matching("#250").sum() == 1 and table.matching("250g").sum() == n // 2
    assert table.matching("B 250g committed nonsense").sum() == 0
    assert table.matching("1.2.3").sum() == 0
    descending = table.sorted_rows(1, descending=True)
    assert plates[descending[0]] == "L" and descending[0] < descending[1]
    assert columns[2].text(0) == "–" and columns[0].text(n - 1) == "24000"
