"""The pages of a recorded trial, and six conditions beside each other."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtWidgets import QApplication

from gui.analysis.analysis_tab import AnalysisTab
from tests.gui.steps import click, wait_until


def trial_scenes(tab: AnalysisTab) -> Iterator[str]:
    """Show every page of the trial that is open."""
    pages, compare = tab.trial_view, tab.trial_view.compare
    for page in (pages.course, pages.features, compare):
        pages.setCurrentWidget(page)
        if page is compare:
            click(compare.button)
            wait_until(lambda: not tab.worker.is_busy and compare.grid is not None)
        QApplication.processEvents()
        yield f"Analysis, {pages.tabText(pages.currentIndex())}"
    tab.panel.table.selectAll()
    click(compare.overlay_button)
    wait_until(lambda: compare.overlay is not None)
    yield "Analysis, trials over each other"
    compare.show_grid(None)
    pages.setCurrentWidget(pages.readings)
