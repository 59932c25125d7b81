"""The pages of analysis results with the longest names of the paper's analysis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.analysis.accuracy import AccuracyPage
from gui.analysis.confusion import ConfusionPage
from gui.analysis.results import AnalysisResults, ResultsPage, plot_page
from gui.shell.main_window import MainWindow
from rigctl.analysis.published import GROUPS, TASKS
from rigctl.analysis.report.figure import Figure, Matrix, PublishedValue, Series
from rigctl.analysis.report.result_figures import DASHED, STYLES, accuracy_panel
from rigctl.analysis.representations import REPRESENTATIONS
from tests.gui.steps import wait_until

ORIGIN = "SIMULATED data · dense-coding-of-surface-textures-20261123-205501-report-12"
TITLES = [" ".join(filter(None, (task.figure, task.title))) for task in TASKS[:6]]


def results_scenes(window: MainWindow) -> Iterator[str]:
    """Show every kind of page, with a point chosen in each."""
    tab = window.analysis_tab
    words = [ResultsPage(name, html="<p>A sentence.</p>") for name in ("Table 1", "One taxel")]
    more = [ResultsPage(name, html="<p>A sentence.</p>") for name in ("Presets", "Remarks")]
    figures = [
        plot_page("Accuracy", ORIGIN, largest_accuracy()),
        plot_page("Confusion", ORIGIN, *largest_confusion()),
    ]
    pages = (words[0], *figures, words[1], *more)
    sentence, name = "98.85 ± 0.16 % of 48 trials right", ORIGIN.partition(" · ")[2]
    results = AnalysisResults(sentence, pages, name=name, simulated=True)
    tab.results_panel.show_results(results, "Sessions: dense-coding-of-surface-textures-20261123")
    window.stack.setCurrentWidget(tab.results_panel)
    wait_until(lambda: tab.results_view.is_whole)
    yield "Analysis, results"
    for index in (1, 2):
        tab.results_view.setCurrentIndex(index)
        QApplication.processEvents()
        page = tab.results_view.page
        assert isinstance(page, AccuracyPage | ConfusionPage)
        if isinstance(page, AccuracyPage):
            page.plots.make_all()
        graphics = page.plots.graphics if isinstance(page, AccuracyPage) else page.view.graphics
        for key in (Qt.Key.Key_Right, Qt.Key.Key_Down, Qt.Key.Key_Down):
            QTest.keyClick(graphics, key)
        QApplication.processEvents()
        yield f"Analysis, {tab.results_view.tabText(index)}"


def largest_accuracy() -> Figure:
    """Return the curves of all tasks and representations."""
    paper = [PublishedValue(50, 98.85, "the paper 98.85 ± 0.16 %")]
    percent = np.linspace(10, 98, 50).tolist()
    curves = [
        Series(
            r.name, STYLES[r.key], range(1, 51), percent, (1.25,) * 50, published=paper,
            dashed=r.key in DASHED,
        )
        for r in REPRESENTATIONS
    ]  # fmt: skip
    panels = [accuracy_panel(title, curves, 0.0625) for title in TITLES]
    return Figure("Accuracy", panels, ["Mean of 20 draws; bars: standard deviation."])


def largest_confusion() -> list[Figure]:
    """Return the matrices of all tasks and representations."""
    counts = (np.full((16, 16), 1234) + 16_000 * np.eye(16, dtype=np.int64)).tolist()
    note = "% of 34,510 trials a row; C knew the texture"
    return [
        Figure(
            f"{title}: confusion with 50 components",
            [Matrix(r.name, [note], tuple(GROUPS), counts) for r in REPRESENTATIONS],
        )
        for title in TITLES
    ]
