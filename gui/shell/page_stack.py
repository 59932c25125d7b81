"""The pages in the middle of the window, one at a time."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtWidgets import QStackedWidget, QWidget

SMALLEST = QSize(400, 360)


class PageStack(QStackedWidget):
    """A stack of pages with names; ``live`` holds the live plots."""

    def __init__(self) -> None:
        super().__init__()
        self.currentChanged.connect(lambda _: self.updateGeometry())
        self._pages: dict[str, QWidget] = {}

    def minimumSizeHint(self) -> QSize:
        """Return the size that the smallest screen leaves for a page, or less if it is enough."""
        page = self.currentWidget()
        return page.minimumSizeHint().boundedTo(SMALLEST) if page is not None else QSize()

    def add_page(self, name: str, page: QWidget) -> None:
        """Add a page, whose name no other page has."""
        self._pages[name] = page
        self.addWidget(page)

    def show_page(self, name: str) -> None:
        """Show the page with that name."""
        self.setCurrentWidget(self._pages[name])
