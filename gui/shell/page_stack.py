"""The pages in the middle of the window, one at a time."""

from __future__ import annotations

from PySide6.QtCore import QSize
from PySide6.QtWidgets import QApplication, QStackedWidget, QWidget

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

    def setCurrentWidget(self, page: QWidget) -> None:
        """Show a page.

        The focus stays in the middle: from a page that is hidden, Qt moves it to a panel, which
        then counts as used and brings its own page while this one is being shown.
        """
        focus = QApplication.focusWidget()
        if focus is not None and self.isAncestorOf(focus) and page is not self.currentWidget():
            self.setFocus()
        super().setCurrentWidget(page)

    def show_page(self, name: str) -> None:
        """Show the page with that name."""
        self.setCurrentWidget(self._pages[name])
