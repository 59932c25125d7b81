"""Views of analysis results: a figure, and tabs for tables, figures and remarks."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPixmap
from PySide6.QtWidgets import QTabWidget, QTextBrowser, QWidget

from gui.analysis.results import AnalysisResults, ResultsPage
from gui.widgets.labels import plain_tooltip


class FigureView(QWidget):
    """A PNG at the largest undistorted size, on white."""

    def __init__(self) -> None:
        super().__init__()
        self.pixmap = QPixmap()

    def show_file(self, path: str) -> None:
        """Show another figure."""
        self.pixmap = QPixmap(path)
        self.setToolTip(plain_tooltip(path))
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Scale the original, so that the figure is sharp at every size."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        if self.pixmap.isNull():
            return
        ratio = self.devicePixelRatioF()
        scaled = self.pixmap.scaled(
            self.size() * ratio,
            Qt.AspectRatioMode.KeepAspectRatio,
            Qt.TransformationMode.SmoothTransformation,
        )
        scaled.setDevicePixelRatio(ratio)
        size = scaled.deviceIndependentSize()
        left, top = (self.width() - size.width()) / 2, (self.height() - size.height()) / 2
        painter.drawPixmap(round(left), round(top), scaled)


class ResultsView(QTabWidget):
    """One tab per page of the latest results."""

    def show_results(self, results: AnalysisResults) -> None:
        """Replace the tabs; the first page comes to the front."""
        while (page := self.widget(0)) is not None:
            self.removeTab(0)
            page.deleteLater()
        for result in results.pages:
            self.addTab(_view(result), result.name)


def _view(page: ResultsPage) -> QWidget:
    if page.figure:
        figure = FigureView()
        figure.show_file(page.figure)
        return figure
    text = QTextBrowser()
    text.setHtml(page.html)
    return text
