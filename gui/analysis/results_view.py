"""The results of an analysis: a tab for each table, figure and list of remarks."""

from __future__ import annotations

from PySide6.QtWidgets import QTabWidget, QTextBrowser, QVBoxLayout, QWidget

from gui.analysis.results import AnalysisResults, ResultsPage
from gui.widgets.figure_view import FigureView


class ResultsView(QWidget):
    """Shows the pages of one answer at a time."""

    def __init__(self) -> None:
        super().__init__()
        self.tabs = QTabWidget()
        self.tabs.setDocumentMode(True)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.tabs)

    def show_findings(self, found: AnalysisResults) -> None:
        """Show another answer, its first page in front."""
        while (old := self.tabs.widget(0)) is not None:
            self.tabs.removeTab(0)
            old.deleteLater()
        for page in found.pages:
            self.tabs.addTab(_widget(page), page.name)

    def text(self, name: str) -> str:
        """Plain text of a page, empty for a figure."""
        for place in range(self.tabs.count()):
            page = self.tabs.widget(place)
            if self.tabs.tabText(place) == name and isinstance(page, QTextBrowser):
                return page.toPlainText()
        return ""


def _widget(page: ResultsPage) -> QWidget:
    if page.figure:
        figure = FigureView()
        figure.show_file(page.figure)
        return figure
    text = QTextBrowser()
    text.setHtml(page.html)
    return text
