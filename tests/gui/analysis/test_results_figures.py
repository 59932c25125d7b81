"""Curves and confusion matrices are read by pointer and keys, and every page is saved."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QAbstractEventDispatcher, QEventLoop, QPoint, QPointF, QRect, Qt
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel

from gui.analysis.accuracy import ROW_PX, AccuracyPage, AccuracyPlots
from gui.analysis.confusion import ConfusionPage, cell_colour
from gui.analysis.export import FileSaver, painted_image
from gui.analysis.results import AnalysisResults, ResultsPage, figures_csv, plot_page
from gui.analysis.value_file import with_origin
from gui.widgets.theme import DARK, LIGHT
from rigctl.analysis.published import TASKS
from rigctl.analysis.report.figure import Figure, Matrix, PublishedValue, Series
from rigctl.analysis.report.result_figures import accuracy_panel
from tests.gui.full_disk import full_disk
from tests.gui.steps import Harness, click, save_page, wait_until
from tests.gui.texts.plots import cut_plot_texts

_Key = Qt.Key
ORIGINAL = Series("Original", "ink", (1, 2, 3), (20.0, 40.0, 60.0), (1.0, 2.0, 3.0))
SCALED = Series(
    "Speed Scaled", "blue", (1, 2, 3), (30.0, 60.0, 90.0), (0.5, 0.6, 0.7),
    published=[PublishedValue(50, 97.76, "the paper 97.76 ± 0.14 %")],
)  # fmt: skip
BOTH = accuracy_panel("Fig. 3A Individual textures", (ORIGINAL, SCALED), 0.25)
ACCURACY = Figure(
    "Accuracy",
    [BOTH, replace(BOTH, title="Fig. 3B Texture groups")],
    ["Mean of 4 draws; bars: standard deviation."],
)
COUNTS = [[8, 2], [1, 9]]
CONFUSION = Figure(
    "Individual textures: confusion with 3 components",
    [
        Matrix("Original", ["% of 10 trials a row"], ("A", "B"), COUNTS),
        Matrix("Speed Scaled", ["% of 9–11 trials a row"], ("A", "B"), [[8, 1], [2, 9]]),
    ],
)
ORIGIN = "SIMULATED data · report"


@pytest.fixture
def shown(harness: Harness, tmp_path: Path) -> Iterator[Harness]:
    """Yield the window with results that stand in for an analysis."""
    window, tab = harness.window, harness.window.analysis_tab
    window.show_panel("analysis")
    words = ResultsPage("Remarks", html="<ul><li>One remark.</li></ul>", csv="remarks\nOne remark.")
    curves = plot_page("Accuracy", ORIGIN, ACCURACY)
    pages = (curves, plot_page("Confusion", ORIGIN, CONFUSION), words)
    results = AnalysisResults("done", pages, name="session-report-1", simulated=True)
    tab.panel.verify_requested.emit(str(tmp_path / "session"), "")  # sets where pages are saved
    wait_until(lambda: not tab.worker.is_busy)
    tab._finish("analyse", results)
    assert window.stack.currentWidget() is tab.results_panel
    wait_until(lambda: tab.results_view.is_whole)
    yield harness
    tab.trial_view.show_trial(None)
    tab._show(tab.trial_view)


def accuracy_page(harness: Harness) -> AccuracyPage:
    """Return the page of the curves."""
    page = harness.window.analysis_tab.results_view.widget(0)
    assert isinstance(page, AccuracyPage)
    return page


def confusion_page(harness: Harness) -> ConfusionPage:
    """Bring the page of the matrices to the front."""
    view = harness.window.analysis_tab.results_view
    QTest.mouseClick(
        view.tabBar(), Qt.MouseButton.LeftButton, pos=view.tabBar().tabRect(1).center()
    )
    page = view.currentWidget()
    assert isinstance(page, ConfusionPage)
    return page


def test_the_pointer_names_the_nearest_point_of_a_curve(shown: Harness) -> None:
    page = accuracy_page(shown)
    plot = page.plots.plots[0]
    place = plot.getViewBox().mapViewToScene(QPointF(2.2, 57.0))
    page.plots.graphics.scene().sigMouseMoved.emit(place)
    assert page.readout.label.text() == (
        "Fig. 3A Individual textures · Speed Scaled, components 2: 60.00 ± 0.60 % · "
        "the paper 97.76 ± 0.14 %"
    )
    assert page.plots.graphics.accessibleDescription() == page.readout.label.text()


def test_keys_walk_along_curves_and_between_tasks(shown: Harness) -> None:
    page = accuracy_page(shown)
    keys = (
        (_Key.Key_Right, "Original, components 1:"),
        (_Key.Key_End, "Original, components 3:"),
        (_Key.Key_Down, "Speed Scaled, components 3:"),
        (_Key.Key_PageDown, "Texture groups · Speed Scaled, components 3:"),
        (_Key.Key_Home, "Speed Scaled, components 1:"),
    )
    for key, words in keys:
        QTest.keyClick(page.plots.graphics, key)
        assert words in page.readout.label.text()


def test_keys_zoom_about_the_point_and_back(shown: Harness) -> None:
    page = accuracy_page(shown)
    plot = page.plots.plots[0]
    whole = plot.viewRange()
    QTest.keyClick(page.plots.graphics, _Key.Key_Right)
    QTest.keyClick(page.plots.graphics, _Key.Key_Plus)
    assert plot.viewRange()[1][1] - plot.viewRange()[1][0] < whole[1][1] - whole[1][0]
    click(page.whole_button)
    assert plot.viewRange() == whole


def test_the_legend_switches_curves_off_and_the_keys_pass_them_over(shown: Harness) -> None:
    page = accuracy_page(shown)
    page.legend["Original"].click()
    assert page.plots.hidden == {"Original"}
    QTest.keyClick(page.plots.graphics, _Key.Key_Right)
    assert "Speed Scaled, components 1:" in page.readout.label.text()
    page.legend["Speed Scaled"].click()
    QTest.keyClick(page.plots.graphics, _Key.Key_Right)
    assert page.readout.label.text().startswith("Point at a curve")
    icons = [box.icon().pixmap(68, 28).toImage() for box in page.legend.values()]
    assert icons[0] != icons[1]


def test_the_foot_says_what_bars_diamonds_and_dots_are(qapp: QApplication) -> None:
    """The last plot has no value of the paper, as tasks that it does not have."""
    alone = replace(BOTH, series=[ORIGINAL, replace(SCALED, published=())])
    page = AccuracyPage(LIGHT, replace(ACCURACY, panels=[BOTH, alone]), ORIGIN)
    foot = [label.text() for label in page.findChildren(QLabel)]
    words = "Mean of 4 draws; bars: standard deviation. ◆: the paper's value. Dotted: chance. "
    assert words + ORIGIN in foot
    page.close()


def test_one_task_alone_is_shown_large(shown: Harness) -> None:
    page = accuracy_page(shown)
    QTest.keyClick(page.task, _Key.Key_End)
    wait_until(lambda: list(page.plots.plots) == [1])
    QTest.keyClick(page.task, _Key.Key_Home)
    wait_until(lambda: list(page.plots.plots) == [0, 1])


def test_pages_and_plots_are_made_one_in_each_turn_and_plots_only_in_view(shown: Harness) -> None:
    """All of them at once kept the window, and STOP with it, for most of a second."""
    tab, view = shown.window.analysis_tab, shown.window.analysis_tab.results_view
    panels = [replace(BOTH, title=f"Task {task}") for task in range(6)]
    curves = plot_page("Accuracy", ORIGIN, replace(ACCURACY, panels=panels))
    tab._finish("analyse", AnalysisResults("done", (curves,) * 4))
    first = accuracy_page(shown)
    made = [(view.count(), len(first.plots.plots))]
    QTest.keyClick(first.plots.graphics, _Key.Key_PageDown)  # before there is a plot
    log = shown.window.event_log
    before = log.toPlainText()
    tab.save_page("png")  # waits for them
    dispatcher = QAbstractEventDispatcher.instance()
    while not view.is_whole:
        dispatcher.processEvents(QEventLoop.ProcessEventsFlag.AllEvents)
        made.append((view.count(), len(first.plots.plots)))
    assert made[0] == (1, 0) and made[-1] == (4, 6)
    assert np.diff(made, axis=0).sum(axis=1).max() == 1
    wait_until(lambda: ".png" in log.toPlainText()[len(before) :])
    hidden = view.widget(1)
    assert isinstance(hidden, AccuracyPage) and not hidden.plots.plots
    view.setCurrentIndex(1)
    assert not hidden.plots.is_whole
    wait_until(lambda: hidden.plots.is_whole)


def test_an_early_picture_has_every_plot_in_its_place(qapp: QApplication) -> None:
    panels = [replace(BOTH, title=f"Task {task}") for task in range(9)]
    page = AccuracyPage(LIGHT, replace(ACCURACY, panels=panels), ORIGIN)
    page.resize(1000, 800)
    page.show()
    for _ in range(2):
        qapp.processEvents()
    assert not page.plots.is_whole
    picture = painted_image(page.picture(), 1)
    places = [plot.sceneBoundingRect().toAlignedRect() for plot in page.plots.plots.values()]
    assert len(places) == 9
    for place, other in combinations(places, 2):
        assert not place.adjusted(1, 1, -1, -1).intersects(other.adjusted(1, 1, -1, -1))
    for place in places:
        at = page.plots.graphics.mapTo(page._figure, place.topLeft())
        assert picture.rect().contains(QRect(at, place.size()))
        colours = {picture.pixelColor(at.x() + x, at.y() + 60).name() for x in range(100, 200)}
        assert LIGHT.plot in colours
    page.close()


def test_all_tasks_of_the_paper_are_seen_with_their_axes_without_scrolling(
    shown: Harness,
) -> None:
    window, panels = shown.window, []
    for task in TASKS:
        title = " ".join(filter(None, (task.figure, task.title)))
        panels.append(replace(BOTH, title=title))
    pages = (plot_page("Accuracy", ORIGIN, replace(ACCURACY, panels=panels)),)
    window.analysis_tab._finish("analyse", AnalysisResults("done", (*pages, *pages)))
    page = accuracy_page(shown)
    wait_until(lambda: page.plots.is_whole)
    for n_tasks, size in ((len(TASKS), (1280, 800)), (1, (1024, 700))):
        window.resize(*size)
        wait_until(lambda: page.plots.width() == page.plots.graphics.width() > 0)
        wait_until(lambda: page.plots.is_whole)
        QApplication.processEvents()
        view = QRect(QPoint(0, 0), page._area.viewport().size())
        for plot in list(page.plots.plots.values())[:n_tasks]:
            place = plot.sceneBoundingRect().toAlignedRect()
            at = page.plots.graphics.mapTo(page._area.viewport(), place.topLeft())
            assert view.contains(QRect(at, place.size())), f"{plot.titleLabel.text}, {size}"
    window.resize(1280, 800)


def test_a_low_plot_has_a_short_name_for_its_axis(qapp: QApplication) -> None:
    """A strip above the results takes the height that the whole name needs."""
    plots = AccuracyPlots(LIGHT, ACCURACY)
    plots.show()
    for height_px, name in ((300, "Accuracy (%)"), (ROW_PX, "%"), (300, "Accuracy (%)")):
        plots.resize(600, height_px)
        wait_until(lambda: plots.is_whole)
        for _ in range(3):
            qapp.processEvents()
        assert plots.plots[0].getAxis("left").labelText == name
        assert cut_plot_texts(plots.graphics) == []
    plots.close()


def test_a_cell_is_named_by_pointer_and_keys(shown: Harness) -> None:
    page = confusion_page(shown)
    assert "Original: 85.00 %" in page.name.text() and "10 trials" in page.words.text()
    place = page.view.item.getViewBox().mapViewToScene(QPointF(1.5, 0.5))
    page.view.graphics.scene().sigMouseMoved.emit(place)
    assert page.readout.label.text().startswith("A taken for B: 2 of 10 trials (20.0")
    QTest.keyClick(page.view.graphics, _Key.Key_Left)
    assert page.readout.label.text().startswith("A: 8 of 10 trials")
    QTest.keyClick(page.representation, _Key.Key_Down)
    assert "Speed Scaled" in page.name.text()
    QTest.keyClick(page.view.graphics, _Key.Key_Right)
    QTest.keyClick(page.view.graphics, _Key.Key_Right)
    assert page.readout.label.text().startswith("A taken for B: 1 of 9 trials")


def test_the_colour_of_a_cell_is_that_of_its_share(shown: Harness) -> None:
    """pyqtgraph stretched the colours, so that the largest share looked like 100 %."""
    view = confusion_page(shown).view
    place = view.item.getViewBox().mapViewToScene(QPointF(0.2, 0.2)).toPoint()
    colour = view.graphics.grab().toImage().pixelColor(place)
    assert colour.name() == cell_colour(LIGHT, view.matrix.share(0, 0)) != LIGHT.accent


def test_both_themes_draw_the_point_anew(shown: Harness) -> None:
    tab = shown.window.analysis_tab
    page = accuracy_page(shown)
    light = page.grab().toImage().pixelColor(5, 60)
    tab.set_theme(DARK)
    wait_until(lambda: len(page.plots.plots) == 2)
    tab.set_theme(LIGHT)
    assert page.grab().toImage().pixelColor(5, 60) == light


def save(harness: Harness, suffix: str) -> Path:
    """Save the page in front; return the file."""
    return save_page(harness, harness.window.analysis_tab.results_view.save_button, suffix)


def test_every_page_is_saved_in_every_format_under_new_names(
    shown: Harness, tmp_path: Path
) -> None:
    view = shown.window.analysis_tab.results_view
    folder = tmp_path / "session-figures"
    for index, name in enumerate(("accuracy", "confusion", "remarks")):
        view.setCurrentIndex(index)
        picture = save(shown, "png")
        assert picture == folder / f"session-report-1-{name}-simulated.png"
        assert QImage(str(picture)).width() > 400
        assert save(shown, "png").name == f"session-report-1-{name}-simulated-2.png"
        drawing = save(shown, "svg").read_text()
        assert drawing.startswith("<?xml") and "SIMULATED data" in drawing
        assert save(shown, "pdf").read_bytes().startswith(b"%PDF")
        with save(shown, "csv").open() as file:
            assert {row["simulated"] for row in csv.DictReader(file)} == {"yes"}
    origin = shown.window.analysis_tab.results_panel.origin
    assert origin.isVisible() and origin.text() == "SIMULATED data · session-report-1"
    text = (folder / "session-report-1-accuracy-simulated.csv").read_text()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 12
    assert (rows[5]["y is"], rows[5]["y"]) == ("accuracy (%)", "90.0000")
    assert (rows[5]["bar from"], rows[5]["bar to"]) == ("89.3000", "90.7000")
    assert rows[5]["the paper's value"] == "the paper 97.76 ± 0.14 %"
    assert (rows[5]["dotted line"], rows[5]["simulated"]) == ("25.0000", "yes")
    cells = list(csv.DictReader(io.StringIO(figures_csv([CONFUSION]))))
    assert cells[1]["count (trials)"] == "2" and cells[1]["predicted texture"] == "B"
    assert cells[1]["share of the true texture (%)"] == "20.0000"


def test_the_file_menu_saves_the_page_in_front(shown: Harness, tmp_path: Path) -> None:
    window, lines = shown.window, shown.window.save_menu.actions
    assert [action.text() for action in lines.values()] == ["PNG", "SVG", "PDF", "CSV"]
    assert all(action.isEnabled() for action in lines.values())
    confusion_page(shown)
    lines["csv"].trigger()
    path = tmp_path / "session-figures" / "session-report-1-confusion-simulated.csv"
    wait_until(path.is_file)
    wait_until(lambda: path.name in window.event_log.toPlainText())
    window.show_panel("operate")
    assert not any(action.isEnabled() for action in lines.values())
    tab = window.analysis_tab
    tab.trial_view.show_trial(None)
    tab._show(tab.trial_view)
    window.show_panel("analysis")
    assert not any(action.isEnabled() for action in lines.values()), "no trial is shown"
    tab._show(tab.results_panel)
    assert all(action.isEnabled() for action in lines.values())


def test_a_table_with_a_comment_gets_the_column_of_its_origin() -> None:
    text = '# taxel 5, "A"; units\nsample,v\n0,-65\n1,-64\n'
    said = with_origin(text, simulated=True)
    assert said == '# taxel 5, "A"; units\nsample,v,simulated\n0,-65,yes\n1,-64,yes\n'
    assert with_origin(said, simulated=True) == said
    assert with_origin('"a, b"\n"x\ny"\n', simulated=False) == '"a, b",simulated\n"x\ny",no\n'


def test_a_full_disk_leaves_no_file(qapp: QApplication, tmp_path: Path) -> None:
    files, said = FileSaver(), list[str]()
    files.failed.connect(said.append)
    with full_disk(4096):
        files.save(str(tmp_path), "accuracy", "csv", bytes(8192))
        wait_until(lambda: bool(said))
    assert "accuracy.csv cannot be written" in said[0]
    assert not list(tmp_path.iterdir())


def test_a_folder_in_the_way_is_said(shown: Harness, tmp_path: Path) -> None:
    (tmp_path / "session-figures").write_text("in the way")
    button = shown.window.analysis_tab.results_view.save_button
    button.formats.actions()[0].trigger()
    wait_until(lambda: "session-figures cannot be made" in shown.window.event_log.toPlainText())
    assert (tmp_path / "session-figures").is_file()
