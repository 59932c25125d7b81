"""The table of trials with its keys."""

from __future__ import annotations

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QHeaderView, QTableView

from gui.analysis.trials.sort_header import SortHeader

ROW_MARGIN_PX = 4
_OPENS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class TrialTableView(QTableView):
    """Rows to choose from; above the first one the focus goes to the names of the columns."""

    opened = Signal()
    """Return, or a double click on a row."""
    typed = Signal(str)
    """Letters, which Qt would search 24,000 rows for."""
    font_changed = Signal()
    """Rows have the height of other letters; columns follow."""

    def __init__(self) -> None:
        super().__init__(showGrid=False)
        self.header = SortHeader()
        self.setHorizontalHeader(self.header)
        self.verticalHeader().hide()
        self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        self.setSelectionBehavior(QTableView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QTableView.SelectionMode.ExtendedSelection)
        self.setMinimumHeight(150)
        self.setAlternatingRowColors(True)
        self.setWordWrap(False)
        self.setHorizontalScrollMode(QTableView.ScrollMode.ScrollPerPixel)
        self.setTabKeyNavigation(False)  # Tab leaves a table of 24,000 trials
        self.header.left.connect(self.setFocus)
        bar = self.horizontalScrollBar()
        self.header.scroll_requested.connect(lambda pixels: bar.setValue(bar.value() + pixels))
        self.doubleClicked.connect(lambda _: self.opened.emit())
        self._fit_rows()

    def changeEvent(self, event: QEvent) -> None:
        """Follow the size of the texts."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange:
            self._fit_rows()
            self.font_changed.emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Open a trial, or go up to the names of the columns; all else is Qt's."""
        row = self.currentIndex().row()
        if event.key() in _OPENS and row >= 0:
            if not event.isAutoRepeat():
                self.opened.emit()
        elif event.key() == Qt.Key.Key_Up and row <= 0 and not event.modifiers():
            self.header.setFocus(Qt.FocusReason.ShortcutFocusReason)
        else:
            super().keyPressEvent(event)

    def _fit_rows(self) -> None:
        self.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + ROW_MARGIN_PX)

    def keyboardSearch(self, search: str) -> None:
        """Pass letters on to the filter."""
        self.typed.emit(search)
