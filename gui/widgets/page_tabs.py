"""Pages behind tabs, as low as the page in front allows."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QTabWidget

from gui.widgets.theme import scaled_px

LEAST_PX = 150
"""Least height of a page, for some lines of a list or a table that scrolls by itself."""


class PageTabs(QTabWidget):
    """Tabs that need the height of their page in front.

    Qt's own ask for the height that the highest of the pages would like to have.
    """

    def __init__(self) -> None:
        super().__init__(documentMode=True)
        self.tabBar().setUsesScrollButtons(False)  # the page scrolls rather than hides a tab
        self.currentChanged.connect(lambda _: self.updateGeometry())

    def hasHeightForWidth(self) -> bool:
        """Say that a narrower page may be higher."""
        return True

    def heightForWidth(self, width: int) -> int:
        """Return the least height at a width."""
        head_px = self.tabBar().sizeHint().height()
        if (corner := self.cornerWidget(Qt.Corner.TopRightCorner)) is not None:
            head_px = max(head_px, corner.sizeHint().height())
        if not self.count():
            return head_px
        page = self.currentWidget()
        least_px, layout = page.minimumSizeHint().height(), page.layout()
        if layout is not None and layout.hasHeightForWidth():
            least_px = layout.totalMinimumHeightForWidth(width)
        return head_px + max(least_px, page.minimumHeight(), scaled_px(LEAST_PX))
