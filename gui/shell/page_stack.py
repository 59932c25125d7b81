"""The pages in the middle of the window, one at a time."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QApplication, QScrollArea, QStackedWidget, QWidget

from gui.widgets.theme import text_scale

_LEAST_PX, _WIDER_PX, _LOWER_PX, _LOWEST_PX = QSize(400, 360), 380, 440, 200
"""What a page is left in a small window. Texts twice as large make it so much wider and lower:
the panels beside it are then narrow, and what is above and below it is high."""


class PageArea(QScrollArea):
    """Fills its room with a page, and scrolls one that needs more: a low screen, large texts.

    Qt's own resizing of the page gives it the height that it would like to have, not the one
    that it needs.
    """

    def __init__(self, page: QWidget) -> None:
        super().__init__()
        self.page = page
        self.setFrameShape(QScrollArea.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # Tab leads to the controls in it
        self.setWidget(page)
        self.fit()

    def fit(self) -> None:
        """Give the page the room, or what it needs beside the scroll bars."""
        bars = self.verticalScrollBar(), self.horizontalScrollBar()
        width_px, height_px = self.maximumViewportSize().toTuple()
        is_high = _least_size(self.page, width_px).height() > height_px
        room = QSize(width_px - is_high * bars[0].sizeHint().width(), height_px)
        needs = _least_size(self.page, room.width())
        if needs.width() > room.width():
            room.setHeight(height_px - bars[1].sizeHint().height())
            if needs.height() > room.height() and not is_high:
                room.setWidth(width_px - bars[0].sizeHint().width())
        self.page.resize(needs.expandedTo(room))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the page into the new room."""
        super().resizeEvent(event)
        self.fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Fit the page when it needs another size."""
        if watched is self.page and event.type() == QEvent.Type.LayoutRequest:
            self.fit()
            self.updateGeometry()
        return super().eventFilter(watched, event)

    def minimumSizeHint(self) -> QSize:
        """Return the size that the smallest screen leaves for a page, or less if it is enough."""
        larger = max(0.0, text_scale() - 1)
        height_px = max(_LOWEST_PX, _LEAST_PX.height() - round(larger * _LOWER_PX))
        most = QSize(_LEAST_PX.width() + round(larger * _WIDER_PX), height_px)
        needs = self.page.minimumSizeHint() + QSize(self.verticalScrollBar().sizeHint().width(), 0)
        return needs.boundedTo(most)

    def sizeHint(self) -> QSize:
        """Return the size that the page would like to have."""
        return self.page.sizeHint()


class PageStack(QStackedWidget):
    """A stack of pages with names, each in a :class:`PageArea`."""

    def __init__(self) -> None:
        super().__init__()
        self.currentChanged.connect(lambda _: self.updateGeometry())
        self._pages: dict[str, QWidget] = {}
        self._areas: dict[QWidget, PageArea] = {}

    def minimumSizeHint(self) -> QSize:
        """Return what the present page needs."""
        area = super().currentWidget()
        return area.minimumSizeHint() if area is not None else QSize()

    def add_page(self, name: str, page: QWidget) -> None:
        """Add a page, whose name no other page has."""
        self._pages[name] = page
        self._areas[page] = PageArea(page)
        self.addWidget(self._areas[page])

    def currentWidget(self) -> QWidget:
        """Return the present page."""
        area = super().currentWidget()
        assert isinstance(area, PageArea)
        return area.page

    def setCurrentWidget(self, page: QWidget) -> None:
        """Show a page.

        The focus stays in the middle: from a page that is hidden, Qt moves it to a panel, which
        then counts as used and brings its own page while this one is being shown.
        """
        focus = QApplication.focusWidget()
        if focus is not None and self.isAncestorOf(focus) and page is not self.currentWidget():
            self.setFocus()
        super().setCurrentWidget(self._areas[page])

    def show_page(self, name: str) -> None:
        """Show the page with that name."""
        self.setCurrentWidget(self._pages[name])


def _least_size(page: QWidget, width_px: int) -> QSize:
    """Return the smallest size of a page that is at least so wide."""
    least, layout = page.minimumSizeHint().expandedTo(page.minimumSize()), page.layout()
    if layout is not None and layout.hasHeightForWidth():
        needs_px = layout.totalMinimumHeightForWidth(max(width_px, least.width()))
        least.setHeight(max(needs_px, page.minimumHeight()))
    return least
