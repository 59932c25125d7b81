"""A recorded session plays in the views of live samples, with v(t) and a movie."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton, QTableView, QWidget

from gui.analysis.trial_sections import ReplayTrial
from gui.live.navigation import SPANS_S
from gui.live.replay_page import NO_ATTEMPT, NO_SESSION, Player, ReplayPage
from gui.live.sample_history import TimeWindow
from gui.live.spike_clicks import Channel
from gui.live.spike_sound import Take
from rigctl.encoder.encoder import encode_trial
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import WrongUse
from rigctl.session.notes import read_notes
from rigctl.session.session import Session
from tests.analysis.recordings import record
from tests.gui.live.speaker import Speaker
from tests.gui.steps import SharedWindow, click, wait_until
from tests.gui.texts.plots import cut_plot_texts
from tests.session.building import SyntheticRig, plan, recorder


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a session on the simulated bench."""
    return record(tmp_path_factory.mktemp("recorded") / "session", repeats=1)


def test_a_session_replays_with_v_of_t_and_becomes_a_movie(
    disconnected: SharedWindow, session: Path
) -> None:
    window = disconnected.window
    page = window.replay.page
    actions = {action.text(): action for action in window.findChildren(QAction)}
    actions["&Replay a session"].trigger()
    assert window.stack.currentWidget() is page
    page.session.setText(str(session))
    QTest.keyClick(page.session, Qt.Key.Key_Return)
    wait_until(lambda: page.player.length > 0 and not page.worker.is_busy)
    with Session.open(session) as recorded:
        samples = np.ascontiguousarray(recorded.samples(0))
    history = page.plots.data.history
    assert np.array_equal(history.samples.between(0, len(samples)), samples)
    assert "Trial " in page.sentence.text()
    seconds = len(samples) / 1000
    assert page.plots.navigation.span_s == min(s for s in SPANS_S if s >= seconds)

    page.speed.setValue(100.0)
    click(page.play)
    wait_until(lambda: page.player.has_ended)
    assert page.play.text() == "Play"
    assert page.plots.navigation.window.right == len(samples) - 1
    assert page.plots.time_plots.raster_plot.getAxis("bottom").labelText == "Time in the trial (s)"

    page.place.setValue(400)
    assert page.plots.navigation.window.right == 400
    time_s, shown_mv = page.voltage.curves[0].getData()
    assert time_s[-1] == pytest.approx(0.4, abs=0.002)
    spikes = history.spikes.between(0, 401)[:, 0]
    assert np.array_equal(shown_mv[:401] >= 30.0, spikes > 0)
    assert cut_plot_texts(page.voltage.graphics) == []
    span_s = page.plots.navigation.span_s
    for right, shown_s in ((400, span_s), (400, 0.05)):  # numbers at both ends
        page.plots.navigation.set_span(shown_s)
        page.place.setValue(right)
        QApplication.processEvents()
        assert cut_plot_texts(page.plots.graphics) == []
    page.plots.navigation.set_span(span_s)

    click(page.movies.button)
    assert page.movies.button.text() == "Cancel"
    wait_until(lambda: "%" in page.sentence.text(), 120_000)
    click(page.movies.button)
    assert page.sentence.text() == "The movie is cancelled."
    assert [path.name for path in session.parent.glob("*attempt*")] == []

    page.movies.length.setValue(0.2)
    click(page.movies.button)
    wait_until(lambda: not page.movies.worker.is_busy, 120_000)
    (movie,) = session.parent.glob("session-attempt1-T1-*.gif")
    assert movie.stat().st_size > 10_000 and str(movie) in page.sentence.text()

    page.movies.kind.setCurrentText("MP4")
    click(page.movies.button)
    wait_until(lambda: not page.movies.worker.is_busy, 120_000)
    wants_ffmpeg = "needs ffmpeg" in page.sentence.text()
    assert wants_ffmpeg or len(list(session.parent.glob("session-attempt1-T1-*.mp4"))) == 1
    assert page.movies.button.text() == "Movie"
    page.movies.kind.setCurrentText("GIF")
    window.replay.hide()
    assert window.stack.currentWidget() is window.live_page


def test_the_worker_fills_the_live_views_with_the_extremes_of_the_trial(
    disconnected: SharedWindow, session: Path
) -> None:
    """The window took a third of a second for ten minutes, and STOP waited."""
    page = disconnected.window.replay.page
    disconnected.window.replay.show()
    with Session.open(session) as recorded:
        samples = np.ascontiguousarray(recorded.samples(1))
    page.open(str(session), 1)
    sent: list[object] = []
    page.worker.finished.connect(lambda _, result: sent.append(result))
    wait_until(lambda: "Trial 2:" in page.sentence.text() and not page.worker.is_busy)
    trial = next(result for result in sent if isinstance(result, ReplayTrial))
    assert trial.history is page.plots.data.history and trial.drum is page.plots.data.drum
    columns = trial.history.columns(0, 4, 5, len(samples))
    low, high = trial.history.extremes(columns)
    assert np.array_equal(low.min(axis=0), trial.low) and (trial.low == samples.min(axis=0)).all()
    assert np.array_equal(high.max(axis=0), samples.max(axis=0))
    disconnected.window.replay.hide()


def test_the_next_trial_follows_where_asked(disconnected: SharedWindow, session: Path) -> None:
    window = disconnected.window
    page = window.replay.page
    window.replay.show()
    page.open(str(session))
    wait_until(lambda: page.player.length > 0 and not page.worker.is_busy)
    page.whole_session.setChecked(True)
    page.speed.setValue(1000.0)
    click(page.play)
    wait_until(lambda: page.trial.value() >= 2 and not page.worker.is_busy)
    page.whole_session.setChecked(False)
    assert "Trial " in page.sentence.text()
    page.player.stop()
    window.replay.hide()


def test_the_trial_that_is_chosen_in_analysis_is_replayed(
    disconnected: SharedWindow, session: Path, tmp_path: Path
) -> None:
    window = disconnected.window
    page, trials = window.replay.page, window.analysis_tab.panel.trials
    page.speed.setValue(1.0)
    window.show_panel("analysis")
    window.analysis_tab.panel.folder.setText(str(session))
    click(window.analysis_tab.panel.open_button)
    wait_until(lambda: trials.has_choice and not window.analysis_tab.reader.is_busy)
    trials.table.selectRow(2)
    click(trials.replay_button)
    assert window.stack.currentWidget() is page
    wait_until(lambda: page.player.is_playing and "Trial 3:" in page.sentence.text())
    assert (page.session.text(), page.trial.value()) == (str(session), 3)

    click_row(trials.table, 4)
    wait_until(lambda: "Trial 5:" in page.sentence.text() and not page.player.is_playing)
    QTest.keyClick(trials.table, Qt.Key.Key_Down)
    wait_until(lambda: "Trial 6:" in page.sentence.text())
    assert window.stack.currentWidget() is page and not page.player.is_playing
    click(button_of(page, "Back"))
    assert window.stack.currentWidget() is window.analysis_tab.trial_view

    click_row(trials.table, 1)
    wait_until(lambda: not window.analysis_tab.reader.is_busy)
    actions = {action.text(): action for action in window.findChildren(QAction)}
    actions["&Replay a session"].trigger()
    wait_until(lambda: "Trial 2:" in page.sentence.text() and not page.worker.is_busy)
    click(button_of(page, "Back"))
    QTest.keyClick(trials.table, Qt.Key.Key_Return)
    wait_until(lambda: page.player.is_playing)
    click(button_of(page, "Back"))
    double_click_row(trials.table, 0)
    wait_until(lambda: page.player.is_playing and "Trial 1:" in page.sentence.text())
    page.player.stop()
    window.replay.hide()
    window.analysis_tab.panel.show_unopened("No session is open.")
    assert not trials.replay_button.isEnabled()
    assert trials.replay_button.toolTip() == "Choose a trial first"


def test_a_note_at_the_moment_of_a_replay_is_a_mark_there(
    disconnected: SharedWindow, session: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(session, tmp_path / "noted"))
    window = disconnected.window
    page = window.replay.page
    window.replay.show()
    page.open(str(folder), 1)
    wait_until(lambda: "Trial 2:" in page.sentence.text() and not page.worker.is_busy)
    page.place.setValue(400)
    QTest.keyClicks(page.note_box.text, "a squeak")
    click(page.note_box.add_button)
    wait_until(lambda: bool(read_notes(folder)))
    (note,) = read_notes(folder)
    assert (note.trial_id, note.at_s, note.text) == (2, 0.4, "a squeak")
    wait_until(lambda: not page.worker.is_busy)
    page.trial.setValue(1)
    wait_until(lambda: "Trial 1:" in page.sentence.text())
    assert not shown_notes(page)
    page.trial.setValue(2)
    wait_until(lambda: "Trial 2:" in page.sentence.text())
    assert shown_notes(page) == [(400, "a squeak")]
    window.replay.hide()


def shown_notes(page: ReplayPage) -> list[tuple[int, str]]:
    """Return position and text of the notes that the plots mark."""
    window = TimeWindow(10_000, 10_000, 0)
    marks = page.plots.data.marks.within(window)
    return [(round(mark.position), mark.text) for mark in marks if mark.kind == "note"]


def place_of(table: QTableView, row: int) -> QPoint:
    """Return where the first cell of a row is."""
    table.scrollTo(table.model().index(row, 0))
    return table.visualRect(table.model().index(row, 0)).center()


def click_row(table: QTableView, row: int) -> None:
    """Click on a row."""
    QTest.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=place_of(table, row))


def double_click_row(table: QTableView, row: int) -> None:
    """Click twice on a row."""
    click_row(table, row)
    QTest.mouseDClick(table.viewport(), Qt.MouseButton.LeftButton, pos=place_of(table, row))


def button_of(page: QWidget, text: str) -> QPushButton:
    """Return the button with that text."""
    return next(b for b in page.findChildren(QPushButton) if b.text() == text)


def test_replay_offers_the_last_session(disconnected: SharedWindow, session: Path) -> None:
    """Without a chosen trial, as after a start, the field has the last session's path."""
    window = disconnected.window
    page = window.replay.page
    window.sessions.remember(str(session))
    window.activateWindow()
    wait_until(window.isActiveWindow)
    keys = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
    QTest.keyClick(window, Qt.Key.Key_R, keys)
    wait_until(page.isVisible)
    click(button_of(page, "Back"))
    page.session.clear()
    QTest.keyClick(window, Qt.Key.Key_R, keys)
    wait_until(page.session.hasFocus)
    assert page.session.text() == str(session) and "Press Return" in page.sentence.text()
    QTest.keyClick(page.session, Qt.Key.Key_Return)
    wait_until(lambda: "Trial 1:" in page.sentence.text() and not page.worker.is_busy)
    window.replay.hide()


def test_a_folder_that_is_no_session_is_refused_in_a_sentence(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    page = disconnected.window.replay.page
    disconnected.window.replay.show()
    page.open(str(tmp_path))
    wait_until(lambda: not page.worker.is_busy)
    assert str(tmp_path) in page.sentence.text() and "Traceback" not in page.sentence.text()
    click(page.play)
    assert not page.player.is_playing, "the trial of before is not that of this folder"
    page.session.clear()
    QTest.keyClick(page.session, Qt.Key.Key_Return)
    assert page.sentence.text() == NO_SESSION and not page.worker.is_busy
    disconnected.window.replay.hide()


def test_a_replay_keeps_within_the_trial() -> None:
    player = Player()
    player.length = 100
    player.move_to(1e9)
    assert player.position == 99 and player.has_ended
    player.play()
    assert player.position == 0 and player.is_playing
    player.stop()
    player.move_to(-5)
    assert player.position == 0 and not player.is_playing


def test_voltage_and_spikes_are_of_one_encoder() -> None:
    from rigctl.encoder.encoder import membrane_mv

    samples = np.random.default_rng(1).integers(200, 800, (300, 1)).astype(np.uint16)
    ranges = Normalisation(np.array([200], np.uint16), np.array([800], np.uint16))
    fired = np.flatnonzero(membrane_mv(samples, ranges)[:, 0] >= 30.0)
    assert np.array_equal(np.unique(encode_trial(samples, ranges).train(0)), fired)


def test_a_session_that_grows_is_followed_with_its_age(
    disconnected: SharedWindow, tmp_path: Path
) -> None:
    """As ``rigctl gui --follow``: the newest attempt, each that comes, and the end."""
    window, of, folder = disconnected.window, plan(), tmp_path / "growing"
    with recorder(folder) as rec:
        rec.begin_part("start", "A")
        source = SyntheticRig(rec)
        rec.wait_written()
        window.replay.follow(str(folder))
        page = window.replay.page
        wait_until(lambda: page.sentence.text() == NO_ATTEMPT)
        for number in range(2):
            source.trial(of.trials[number])
        rec.wait_written()
        page.speed.setValue(1000.0)
        wait_until(lambda: "Trial 2:" in page.sentence.text() and page.player.has_ended)
        source.trial(of.trials[2])
        rec.wait_written()
        wait_until(lambda: "Trial 3:" in page.sentence.text())
        wait_until(lambda: page.growth.text().startswith("Recording: 3 attempts, newest data "))
    wait_until(lambda: not page.growth.isVisible())
    page.whole_session.setChecked(False)
    page.speed.setValue(1.0)
    page.player.stop()
    window.replay.hide()


def test_a_replay_is_heard_while_it_plays(disconnected: SharedWindow, session: Path) -> None:
    page = disconnected.window.replay.page
    speaker = Speaker()
    page.sound.open_device = speaker.open
    page.open(str(session), 1)
    wait_until(lambda: page.player.length > 0 and not page.worker.is_busy)
    page.sound.channel.setCurrentText(Channel.SA)
    wait_until(lambda: speaker.is_open)
    disconnected.window.replay.show()
    page.speed.setValue(1.0)
    assert not speaker.listen().any()
    click(page.play)
    wait_until(lambda: bool(speaker.listen().any()))
    click(page.play)
    page.sound.channel.setCurrentText(Channel.NONE)
    wait_until(lambda: not speaker.is_open)

    def refuse(_: Take) -> Speaker:
        raise WrongUse("no sound: connect speakers")

    page.sound.open_device = refuse
    page.sound.channel.setCurrentText(Channel.RA)
    wait_until(lambda: page.sentence.text() == "no sound: connect speakers")
    assert page.sound.chosen is Channel.NONE
    assert "no sound: connect speakers" in disconnected.window.event_log.toPlainText()
    page.closed.emit()
