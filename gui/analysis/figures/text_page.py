"""A page of results in words or as a table."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QAbstractTextDocumentLayout, QPainter, QPalette
from PySide6.QtWidgets import QTextBrowser

from gui.analysis.export.picture_file import Picture
from gui.widgets.theme import Theme

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
