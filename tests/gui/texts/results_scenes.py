"""The pages of analysis results with the longest names of the paper's analysis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.analysis.figures.accuracy import (
    AccuracyCurve,
    AccuracyPanel,
    AccuracyPlot,
    PublishedAccuracy,
)
from gui.analysis.figures.accuracy_page import AccuracyPage
from gui.analysis.figures.confusion import ConfusionCounts, ConfusionPlot
from gui.analysis.figures.confusion_page import ConfusionPage
from gui.analysis.figures.read_results import SEEN
from gui.analysis.results import AnalysisResults, ResultsPage, plot_page
from gui.shell.main_window import MainWindow
from rigctl.analysis.published import GROUPS, TASKS
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
        plot_page("Accuracy", largest_accuracy()),
        plot_page("Confusion", largest_confusion()),
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


def largest_accuracy() -> AccuracyPlot:
    """Return the curves of all tasks and representations."""
    percent = tuple(np.linspace(10, 98, 50).tolist())
    paper = PublishedAccuracy(98.85, 0.16, 50)
    curves = tuple(
        AccuracyCurve(r.key, r.name, percent, (1.25,) * 50, paper) for r in REPRESENTATIONS
    )
    panels = tuple(AccuracyPanel(title, 6.25, curves, "sd over 20 draws") for title in TITLES)
    return AccuracyPlot(panels, ORIGIN, True)


def largest_confusion() -> ConfusionPlot:
    """Return the matrices of all tasks and representations."""
    counts = np.full((16, 16), 1234) + 16_000 * np.eye(16, dtype=np.int64)
    matrices = tuple(
        ConfusionCounts(title, r.name, 50, tuple(GROUPS), counts, SEEN)
        for title in TITLES
        for r in REPRESENTATIONS
    )
    return ConfusionPlot(matrices, ORIGIN, True)
