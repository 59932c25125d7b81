"""A recorded trial shows its force, speed and features, and is saved as picture or table."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.analysis.open_sessions import OpenSessions
from gui.analysis.results import table
from gui.analysis.results_view import TextPage
from gui.analysis.run_box import PAPER
from gui.analysis.trial_overlay import overlay_trials
from gui.analysis.trial_pages import trial_ticks
from gui.shell.docks import PageArea
from tests.analysis.recordings import record
from tests.gui.full_disk import full_disk
from tests.gui.steps import Harness, click, save_page, wait_until

HEADING = "SIMULATED data · Trial 1: plate B, 40 mm/s, 250 g, committed"


@pytest.fixture
def shown(harness: Harness, tmp_path: Path) -> Iterator[Harness]:
    """Yield the window with the first trial of a session."""
    kind = {"repeats": 2, "travel_mm": 24.0, "speeds": (40,), "forces": (250,)}
    session = record(tmp_path / "session", "BD", **kind)
    harness.window.show_panel("analysis")
    tab = harness.window.analysis_tab
    tab.panel.run_box.method.setCurrentIndex(0)
    tab.open_session(str(session))
    wait_until(lambda: tab.trial_view.data is not None and not tab.reader.is_busy)
    yield harness
    tab.panel.run_box.place.clear()
    tab.panel.show_unopened("No session is open.")
    tab.trial_view.show_trial(None)
    tab.trial_view.setCurrentIndex(0)
    harness.window.status_line.clear()


def turn_to(harness: Harness, name: str) -> None:
    """Click on a page of the trial."""
    pages = harness.window.analysis_tab.trial_view
    bar = pages.tabBar()
    at = [pages.tabText(i) for i in range(pages.count())].index(name)
    QTest.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(at).center())
    assert pages.currentIndex() == at


def save(harness: Harness, suffix: str) -> Path:
    """Save the page in front; return the file."""
    return save_page(harness, harness.window.analysis_tab.trial_view.save_button, suffix)


def test_force_and_speed_stand_beside_what_was_planned(shown: Harness) -> None:
    turn_to(shown, "Force and speed")
    view = shown.window.analysis_tab.trial_view.course
    assert view.course is not None and len(view.course.force_g) > 10
    assert abs(np.median(view.course.force_g) - 250) < 5
    assert view.course.planned_mm_s == 40 and view.course.planned_g == 250
    low, high = view.force_plot.viewRange()[1]
    assert low <= 0 and high > 250
    assert (
        view.force_plot.titleLabel.text
        == "SIMULATED data · Trial 1: plate B, 40 mm/s, 250 g, committed"
    )


def test_a_feature_is_read_with_its_unit(shown: Harness) -> None:
    turn_to(shown, "Features")
    view = shown.window.analysis_tab.trial_view.features
    assert view.features is not None and view.features.values.shape == (36, 2)
    image, plot = view.images[0], view.plots[0]
    assert image.image is not None
    place = plot.getViewBox().mapViewToScene(QPointF(1.5, 9.5))
    view.graphics.scene().sigMouseMoved.emit(place)
    read = view.value.text()
    assert read.startswith("SA of taxel 10, window 2: ") and read.endswith(" Hz")
    assert view.value_text(18, 0).startswith("RA of taxel 1, window 1: ")
    assert plot.titleLabel.text == HEADING
    names = [scale.axis.labelText for scale in view.scales]
    assert names == ["Rate (Hz)", "Count (spikes)"]
    top_hz = view.features.values[:18].max()
    assert tuple(view.scales[0].viewRange()[1]) == tuple(image.levels) == (0, pytest.approx(top_hz))
    assert view.plots[1].getAxis("bottom").labelText == "Window, 12 mm of texture each"
    assert view.plots[1].getAxis("bottom")._tickLevels[0] == [(0.5, "1"), (1.5, "2")]


def test_large_texts_need_no_scrolling_sideways(shown: Harness) -> None:
    window, pages = shown.window, shown.window.analysis_tab.trial_view
    words = TextPage(table(["Predicted"] * 10, [["rectangular-ridges"] * 10]))
    window.docks.reset()  # a width that a test before gave a panel would come back, larger
    window.set_text_size(150)
    window.show_panel("finger")  # the widest panel
    window.show_panel("analysis")
    area = next(one for one in window.stack.findChildren(PageArea) if one.page is pages)
    for index in range(pages.count()):
        pages.setCurrentIndex(index)
        QApplication.processEvents()
        assert area.isVisible() and not area.horizontalScrollBar().maximum()
    words.resize(area.size())
    words.show()
    assert not words.horizontalScrollBar().isVisible()
    words.close()
    window.set_text_size(100)


def test_pages_of_an_archive_that_nobody_can_write_into_are_saved_where_the_user_says(
    shown: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = shown.window
    box, log = window.analysis_tab.panel.run_box, window.event_log
    box.method.setCurrentIndex(box.method.findData(PAPER))
    session = window.analysis_tab.panel.path
    before = window.protocol_panel.out.text()
    window.protocol_panel.out.setText(str(tmp_path / "data"))
    monkeypatch.setattr("gui.analysis.task_values.os.access", lambda path, mode: False)
    assert save(shown, "png").parent == tmp_path / "data" / "session-figures"
    box.show_place(session)
    assert box.place.placeholderText() == str(tmp_path / "data")
    box.place.setText(str(tmp_path / "results"))
    assert save(shown, "png").parent == tmp_path / "results" / "session-figures"
    box.place.setText("results")
    log.clear()
    window.analysis_tab.save_page("png")
    wait_until(lambda: "give the whole path of the folder to save in" in log.toPlainText())
    click(box.run_button)
    assert box.result.text().startswith("Results in: give the whole path")
    window.protocol_panel.out.setText(before)


def test_every_page_is_saved_in_two_clicks_and_nothing_is_overwritten(shown: Harness) -> None:
    picture = save(shown, "png")
    assert picture.parent.name == "session-figures"
    assert picture.name == "trial-1-readings-simulated.png"
    assert not QImage(str(picture)).isNull()
    assert save(shown, "png").name == "trial-1-readings-simulated-2.png"
    heading = shown.window.analysis_tab.trial_view.readings.samples_plot.titleLabel
    assert heading.text.startswith("SIMULATED data · Trial 1: plate B")
    turn_to(shown, "Force and speed")
    drawing = save(shown, "svg").read_text()
    assert drawing.startswith("<?xml") and "SIMULATED data · Trial 1: plate B" in drawing
    pdf = save(shown, "pdf").read_bytes()
    assert pdf.startswith(b"%PDF") and pdf.rstrip().endswith(b"%%EOF")
    with save(shown, "csv").open() as file:
        rows = list(csv.DictReader(file))
    data = shown.window.analysis_tab.trial_view.data
    assert data is not None and data.course is not None
    assert [float(row["force (g)"]) for row in rows] == data.course.force_g.tolist()
    turn_to(shown, "Readings")
    with save(shown, "csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["simulated"] for row in rows} == {"yes"}
    samples = data.overview.low
    assert len(rows) == len(samples) and rows[5]["T3 (counts)"] == str(samples[5, 2])
    spikes = sum(int(row["SA 1 (spikes)"]) for row in rows)
    assert spikes == int(data.overview.spikes[:, 0].sum())


def test_a_page_of_recorded_data_says_so(shown: Harness) -> None:
    pages = shown.window.analysis_tab.trial_view
    assert pages.data is not None
    pages.show_trial(pages.data._replace(simulated=False))
    assert pages.readings.samples_plot.titleLabel.text.startswith("Trial 1: plate B")
    file = save(shown, "svg")
    assert file.name == "trial-1-readings.svg"
    assert "SIMULATED" not in file.read_text() and "Trial 1: plate B" in file.read_text()
    with save(shown, "csv").open() as file:
        assert {row["simulated"] for row in csv.DictReader(file)} == {"no"}


def test_a_full_disk_leaves_no_picture_and_says_why(shown: Harness, tmp_path: Path) -> None:
    tab = shown.window.analysis_tab
    tab.reader.cancel()  # its process takes the limit over
    actions = {action.text(): action for action in tab.trial_view.save_button.formats.actions()}
    with full_disk(4096):
        actions["PDF"].trigger()
        actions["PNG"].trigger()
        line = shown.window.event_log
        wait_until(lambda: line.toPlainText().count("cannot be written") >= 2)
    tab.reader.cancel()
    assert "free some space" in shown.window.status_line.text()
    assert list((tmp_path / "session-figures").iterdir()) == []


def test_a_folder_that_cannot_be_written_is_said(shown: Harness, tmp_path: Path) -> None:
    (tmp_path / "session-figures").write_text("in the way")
    button = shown.window.analysis_tab.trial_view.save_button
    button.formats.actions()[0].trigger()
    line = shown.window.status_line
    wait_until(lambda: "session-figures cannot be made" in line.text())


@pytest.mark.parametrize(
    ("trials", "numbers"),
    [
        ([7], "7"),
        ([3, 9], "3 9"),
        ([2, 5, 8, 11], "2 5 8 11"),
        (range(101, 121), "101 106 111 116"),
    ],
)
def test_rows_of_a_raster_have_the_numbers_of_their_trials(
    trials: Sequence[int], numbers: str
) -> None:
    ticks = trial_ticks(trials)
    assert " ".join(text for _, text in ticks) == numbers
    assert all(trials[int(place)] == int(text) for place, text in ticks)


def test_conditions_are_compared_by_raster_and_mean_rate(shown: Harness) -> None:
    tab = shown.window.analysis_tab
    turn_to(shown, "Compare")
    view = tab.trial_view.compare
    assert view.neuron.count() == 36
    view.neuron.setCurrentIndex(view.neuron.findText("T_SA-10"))
    click(view.button)
    wait_until(lambda: view.grid is not None and view.grid.neuron == "T_SA-10")
    assert view.grid is not None and view.note.text().startswith(
        "SIMULATED data. T_SA-10. Line: mean"
    )
    names = [condition.name for condition in view.grid.conditions]
    assert names == ["B, 40 mm/s, 250 g", "D, 40 mm/s, 250 g"]
    first = view.grid.conditions[0]
    assert len(first.spikes_s) == 2 and len(view.rasters) == len(view.rates) == 2
    pooled = sum(map(len, first.spikes_s)) / 2
    assert first.mean_hz.sum() * 0.05 == pytest.approx(pooled, abs=1)
    assert first.sd_hz.max() > 0
    table = save(shown, "csv")
    assert table.name == "compare-simulated.csv"
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(first.at_s) and rows[0]["simulated"] == "yes"
    drawing = save(shown, "svg")
    assert drawing.name == "compare-simulated.svg" and "SIMULATED data" in drawing.read_text()
    assert float(rows[3]["B, 40 mm/s, 250 g: mean (Hz)"]) == pytest.approx(first.mean_hz[3])
    tab.panel.trials.filter.setText("D")
    click(view.button)
    wait_until(lambda: view.grid is not None and len(view.grid.conditions) == 1)
    tab.panel.trials.filter.clear()
    view.show_grid(None)


def test_selected_trials_are_laid_over_each_other_and_saved(shown: Harness) -> None:
    tab = shown.window.analysis_tab
    turn_to(shown, "Compare")
    view, table_view = tab.trial_view.compare, tab.panel.table
    table_view.selectAll()
    click(view.overlay_button)
    wait_until(lambda: view.overlay is not None)
    overlay = view.overlay
    assert overlay is not None and overlay.condition == "several conditions"
    assert [trial.name for trial in overlay.trials] == [f"session, trial {n}" for n in (1, 2, 3, 4)]
    assert overlay.left_out == "" and view.overlaid.isVisible() and not view.plots.isVisible()
    table = save(shown, "csv")
    assert table.name == "laid-over-simulated.csv"
    with table.open() as file:
        rows = list(csv.DictReader(file))
    first = overlay.trials[0]
    assert float(rows[7]["session, trial 1: reading (counts)"]) == first.reading[7]
    assert rows[0]["simulated"] == "yes"
    spikes = [row["session, trial 1: spike time (s)"] for row in rows]
    assert sum(one != "nan" for one in spikes) == len(first.spikes_s)
    assert "SIMULATED data" in save(shown, "svg").read_text()
    click(view.button)
    wait_until(lambda: view.overlay is None and view.grid is not None)
    assert view.plots.isVisible() and not view.overlaid.isVisible()
    view.show_grid(None)


def test_trains_laid_over_each_other_meet_behind_both_modules(
    harness: Harness, tmp_path: Path
) -> None:
    session = record(
        tmp_path / "session", "L", travel_mm=48.0, speeds=(40, 80), forces=(250, 500), repeats=2
    )
    sessions = OpenSessions()
    sessions.open(str(session))
    rows = sessions.drum_session(str(session)).trials
    by = {(row["speed_mm_s"], row["force_g"]): number for number, row in enumerate(rows)}
    places = [(str(session), by[40, 250]), (str(session), by[80, 500])]
    overlay = overlay_trials(sessions, [str(session)], places, taxel=4, is_ra=False)
    weak, strong = overlay.trials
    assert weak.c is not None and weak.c > 1.1 and strong.c == 1.0
    assert len(weak.forced_s) > 1.1 * len(weak.spikes_s)
    assert np.array_equal(strong.forced_s, strong.spikes_s)
    np.testing.assert_allclose(weak.scaled_s, weak.forced_s * 40 / 120)
    edges = np.linspace(0, 48 / 120, 41)
    before, after = (
        np.corrcoef(np.histogram(one, edges)[0], np.histogram(other, edges)[0])[0, 1]
        for one, other in ((weak.spikes_s, strong.spikes_s), (weak.scaled_s, strong.scaled_s))
    )
    assert after > 0.6 > before + 0.2
    receptor = overlay_trials(sessions, [str(session)], places, taxel=4, is_ra=True).trials[0]
    assert receptor.c is None and np.array_equal(receptor.forced_s, receptor.spikes_s)
    view = harness.window.analysis_tab.trial_view.compare
    view.show_overlay(overlay)
    assert f"C: 1 {weak.c:.3g}, 2 1." in view.note.text()
    last = view.overlaid.plots.plots[-1]
    assert last.viewRange()[0][1] == pytest.approx(48 / 120, rel=0.05)
    view.show_grid(None)
