"""The results of an analysis: settings, and pages of plots, pictures, tables and remarks."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QRectF, QSize, QSizeF, Qt, QTimer, QUrl, Signal
from PySide6.QtGui import (
    QAbstractTextDocumentLayout,
    QDesktopServices,
    QPainter,
    QPaintEvent,
    QPalette,
    QPixmap,
)
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QTextBrowser, QWidget

from gui.analysis.accuracy import AccuracyPage
from gui.analysis.confusion import ConfusionPage
from gui.analysis.export import ExportButton, Picture, with_foot
from gui.analysis.results import AnalysisResults, ResultsPage
from gui.analysis.value_file import with_origin
from gui.widgets.labels import label, plain_tooltip
from gui.widgets.layouts import PageTabs, container, hbox, push_button, vbox
from gui.widgets.theme import Theme, applied_theme


class FigureView(QWidget):
    """An SVG or a PNG at the largest undistorted size, on white."""

    def __init__(self) -> None:
        super().__init__()
        self.pixmap, self.drawing = QPixmap(), QSvgRenderer()

    @property
    def is_shown(self) -> bool:
        """Whether there is a figure."""
        return self.drawing.isValid() or not self.pixmap.isNull()

    def show_file(self, path: str) -> None:
        """Show another figure: the SVG beside a PNG, if there is one."""
        drawing = Path(path).with_suffix(".svg")
        self.drawing = QSvgRenderer(str(drawing)) if drawing.exists() else QSvgRenderer()
        self.pixmap = QPixmap() if self.drawing.isValid() else QPixmap(path)
        self.setToolTip(plain_tooltip(path))
        self.setAccessibleName(f"Figure {Path(path).stem}")
        self.update()

    def set_theme(self, theme: Theme) -> None:
        """Keep the figure's own colours."""

    def picture(self) -> Picture:
        """Return the figure in its own size."""
        size = self._size().toSize()
        whole = QRectF(0, 0, size.width(), size.height())

        def paint(painter: QPainter) -> None:
            painter.fillRect(whole, Qt.GlobalColor.white)
            self._draw(painter, whole)

        return Picture(size, paint)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the figure in the middle."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        if self.is_shown:
            fit = Qt.AspectRatioMode.KeepAspectRatio
            size = self._size().scaled(QSizeF(self.size()), fit)
            left, top = (self.width() - size.width()) / 2, (self.height() - size.height()) / 2
            self._draw(painter, QRectF(left, top, size.width(), size.height()))

    def _size(self) -> QSizeF:
        drawing = self.drawing
        return QSizeF(drawing.defaultSize() if drawing.isValid() else self.pixmap.size())

    def _draw(self, painter: QPainter, place: QRectF) -> None:
        if self.drawing.isValid():
            self.drawing.render(painter, place)
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawPixmap(place, self.pixmap, QRectF(self.pixmap.rect()))


WIDTH_PX = 900


class TextPage(QTextBrowser):
    """Shows an HTML text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        # Texts break anywhere, and Qt makes a table a pixel wider than the page.
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setHtml(html)

    def set_theme(self, theme: Theme) -> None:
        """Keep the palette, which Qt applies to the text."""

    def picture(self) -> Picture:
        """Return the whole text in black on white, also what is scrolled out of view."""
        document = self.document().clone()
        document.setTextWidth(WIDTH_PX)
        size = document.size().toSize() + QSize(1, 1)

        def paint(painter: QPainter) -> None:
            painter.fillRect(0, 0, size.width(), size.height(), Qt.GlobalColor.white)
            context = QAbstractTextDocumentLayout.PaintContext()
            palette = QPalette(Qt.GlobalColor.white)
            palette.setColor(QPalette.ColorRole.Text, Qt.GlobalColor.black)
            context.palette = palette
            document.documentLayout().draw(painter, context)

        return Picture(size, paint)


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
        self.setLayout(vbox(head, view, tall=1))

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
