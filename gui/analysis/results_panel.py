"""The results of an analysis below the settings that they were made with."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QUrl, Signal
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QWidget

from gui.analysis.results import AnalysisResults
from gui.analysis.results_view import ResultsView
from gui.widgets.labels import label
from gui.widgets.layouts import container, hbox, push_button, vbox


class ResultsPanel(QWidget):
    """Settings, ways to the report's files, and the pages of the results."""

    refused = Signal(str)

    def __init__(self, view: ResultsView) -> None:
        super().__init__()
        self.origin = label("", "heading", wraps=True)
        self.settings = label("", "muted", wraps=True)
        self.report_button = push_button(
            "Open report", self._open_report, "Show the report in the web browser"
        )
        self.folder_button = push_button(
            "Open folder", self._open_folder, "Show the report's files in the file manager"
        )
        for button in (self.report_button, self.folder_button):
            button.setEnabled(False)
        self._view = view
        self._folder = ""
        words = container(vbox(self.origin, self.settings))
        head = hbox(words, self.report_button, self.folder_button, margins=(8, 6, 8, 4))
        column = vbox(head, view)
        column.setStretch(1, 1)
        self.setLayout(column)

    def show_results(self, results: AnalysisResults, settings: str) -> None:
        """Show results and, in a sentence, the settings that they were made with."""
        self._view.show_results(results)
        self.origin.setText(results.origin)
        self.origin.setVisible(results.simulated)
        self.settings.setText(settings)
        self._folder = results.folder
        for button in (self.report_button, self.folder_button):
            button.setVisible(bool(results.folder))
            button.setEnabled(bool(results.folder))

    def _open_report(self) -> None:
        self._open(Path(self._folder) / "report.html")

    def _open_folder(self) -> None:
        self._open(Path(self._folder))

    def _open(self, path: Path) -> None:
        url = QUrl.fromLocalFile(str(path.absolute()))
        if not path.exists():
            self.refused.emit(f"{path} is no longer there: run the analysis again")
        elif not QDesktopServices.openUrl(url):
            self.refused.emit(f"this desktop has no program to open {path}")
