"""The pages of analysis results: plots that can be read, pictures, tables and remarks."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimer

from gui.analysis.export.export_button import ExportButton
from gui.analysis.export.picture_file import Picture, with_foot
from gui.analysis.export.value_file import with_origin
from gui.analysis.figures.accuracy_page import AccuracyPage
from gui.analysis.figures.confusion_page import ConfusionPage
from gui.analysis.figures.picture_page import FigureView
from gui.analysis.figures.text_page import TextPage
from gui.analysis.results import AnalysisResults, ResultsPage
from gui.widgets.layouts import PageTabs
from gui.widgets.theme import Theme, applied_theme

ResultWidget = AccuracyPage | ConfusionPage | FigureView | TextPage

TURNS_OF_A_PAGE = 2
"""Turns of the event loop that paint a page that was made. A page more in the same turn would hold
a press of STOP for longer."""


class ResultsView(PageTabs):
    """One tab per page of the latest results, made one in each turn of the event loop."""

    def __init__(self) -> None:
        super().__init__()
        self.save_button = ExportButton()
        self.save_button.setEnabled(False)
        self.setCornerWidget(self.save_button, Qt.Corner.TopRightCorner)
        self.results = AnalysisResults("", ())
        self._timer = QTimer(self, interval=0)
        self._timer.timeout.connect(self._add_next)
        self._rested_turns = 0

    @property
    def page(self) -> ResultWidget:
        """The page in front."""
        widget = self.currentWidget()
        assert isinstance(widget, ResultWidget)
        return widget

    @property
    def is_whole(self) -> bool:
        """Whether all pages, and everything on the page in front, are made."""
        return self.count() == len(self.results.pages) and self._is_drawn

    def show_results(self, results: AnalysisResults) -> None:
        """Replace the tabs; the first page comes to the front."""
        self.results = results
        while (page := self.widget(0)) is not None:
            self.removeTab(0)
            page.deleteLater()
        self._timer.start()
        self._add_next()
        self.save_button.setEnabled(bool(results.pages))

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to every page."""
        for index in range(self.count()):
            widget = self.widget(index)
            assert isinstance(widget, ResultWidget)
            widget.set_theme(theme)

    def file_stem(self) -> str:
        """Return results, page and origin as the beginning of a file's name."""
        origin = "-simulated" if self.results.simulated else ""
        name = f"{self.results.name}-{self.tabText(self.currentIndex())}{origin}"
        return name.lower().replace(" ", "-")

    def csv(self) -> str:
        """Return the numbers of the page in front with their origin, empty without any."""
        text = self.results.pages[self.currentIndex()].csv
        return with_origin(text, simulated=self.results.simulated) if text else ""

    def picture(self) -> Picture:
        """Return the page in front; plots and figures have their origin in them."""
        page = self.page
        if isinstance(page, TextPage):
            return with_foot(page.picture(), self.results.origin)
        return page.picture()

    @property
    def _is_drawn(self) -> bool:
        page = self.currentWidget()
        return not isinstance(page, AccuracyPage) or page.plots.is_whole

    def _add_next(self) -> None:
        """Add the next page, if one is missing, once the one in view is made and painted."""
        if self.count() == len(self.results.pages):
            self._timer.stop()
            return
        is_made = self._is_drawn or not self.isVisible()
        self._rested_turns = self._rested_turns + 1 if is_made else 0
        if self.count() > 0 and self._rested_turns <= TURNS_OF_A_PAGE:
            return
        self._rested_turns = 0
        page = self.results.pages[self.count()]
        self.addTab(_view(page, applied_theme()), page.name)


def _view(page: ResultsPage, theme: Theme) -> ResultWidget:
    if page.plots and page.plots[0].matrices:
        return ConfusionPage(theme, page.plots, page.origin)
    if page.plots:
        return AccuracyPage(theme, page.plots[0], page.origin)
    if page.figure:
        figure = FigureView()
        figure.show_file(page.figure)
        return figure
    return TextPage(page.html)
