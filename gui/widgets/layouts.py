"""Layouts and small controls that several panels share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, QSize, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QBoxLayout,
    QComboBox,
    QFormLayout,
    QGroupBox,
    QHBoxLayout,
    QLayout,
    QLayoutItem,
    QPushButton,
    QScrollArea,
    QTableView,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from gui.widgets.theme import scaled_px

_Line = list[tuple[QLayoutItem, int]]
"""The items of a line with their widths in pixels."""


class FlowLayout(QLayout):
    """Puts widgets beside each other, as many in a line as fit.

    Widgets that expand, such as fields and scroll bars, share the spare width of their line.
    ``margins``: left, top, right and bottom.
    """

    def __init__(self, *widgets: QWidget, margins: tuple[int, int, int, int] = (0, 0, 0, 0)):
        super().__init__()
        self._items: list[QLayoutItem] = []
        self._heights_px: dict[int, int] = {}
        """By width; Qt asks for some again and again until an item changes."""
        self.setContentsMargins(*margins)
        self.setSpacing(4)
        for widget in widgets:
            self.addWidget(widget)

    def addItem(self, item: QLayoutItem) -> None:
        """Take an item, as Qt asks for it."""
        self._items.append(item)

    def count(self) -> int:
        """Return the number of items."""
        return len(self._items)

    def itemAt(self, index: int) -> QLayoutItem | None:
        """Return an item, None beyond the last."""
        return self._items[index] if 0 <= index < len(self._items) else None

    def takeAt(self, index: int) -> QLayoutItem | None:
        """Give an item away, None beyond the last."""
        return self._items.pop(index) if 0 <= index < len(self._items) else None

    def hasHeightForWidth(self) -> bool:
        """Say that a narrower row is higher."""
        return True

    def heightForWidth(self, width: int) -> int:
        """Return the height of all lines."""
        if width not in self._heights_px:
            self._heights_px[width] = self._place(QRect(0, 0, width, 0), is_shown=False)
        return self._heights_px[width]

    def invalidate(self) -> None:
        """Measure anew: an item has changed."""
        self._heights_px = {}
        super().invalidate()

    def sizeHint(self) -> QSize:
        """Return the size with everything in one line."""
        widths = [_width(item) for item in self._items if not item.isEmpty()]
        width_px = sum(widths) + self.spacing() * max(0, len(widths) - 1)
        return self._with_margins(width_px)

    def minimumSize(self) -> QSize:
        """Return the size that the widest item needs."""
        return self._with_margins(max(map(_width, self._items), default=0))

    def setGeometry(self, rect: QRect) -> None:
        """Place the items."""
        super().setGeometry(rect)
        self._place(rect, is_shown=True)

    def _with_margins(self, width_px: int) -> QSize:
        margins = self.contentsMargins()
        height_px = max((item.sizeHint().height() for item in self._items), default=0)
        vertical_px = margins.top() + margins.bottom()
        return QSize(width_px + margins.left() + margins.right(), height_px + vertical_px)

    def _place(self, rect: QRect, *, is_shown: bool) -> int:
        """Return the height of all lines; place the items if they are shown."""
        inside = rect.marginsRemoved(self.contentsMargins())
        top = inside.top()
        for line in self._lines(inside.width()):
            height_px = max(item.sizeHint().height() for item, _ in line)
            left = inside.left()
            for item, width_px in line if is_shown else ():
                item.setGeometry(QRect(QPoint(left, top), QSize(width_px, height_px)))
                left += width_px + self.spacing()
            top += height_px + self.spacing()
        return (
            max(top - self.spacing(), inside.top()) - rect.top() + self.contentsMargins().bottom()
        )

    def _lines(self, width_px: int) -> list[_Line]:
        lines: list[list[QLayoutItem]] = []
        used_px = 0
        for item in self._items:
            if item.isEmpty():
                continue
            if not lines or used_px + self.spacing() + _width(item) > width_px:
                lines.append([])
                used_px = -self.spacing()
            lines[-1].append(item)
            used_px += self.spacing() + _width(item)
        return [self._stretched(line, width_px) for line in lines]

    def _stretched(self, line: list[QLayoutItem], width_px: int) -> _Line:
        """Return the widths of a line's items: those that expand share what is left."""
        widths = [_width(item) for item in line]
        spare_px = width_px - sum(widths) - self.spacing() * (len(line) - 1)
        growing = [i for i, item in enumerate(line) if _grows(item)]
        for i in growing:
            widths[i] += max(0, spare_px) // len(growing)
        return list(zip(line, widths, strict=True))


def _width(item: QLayoutItem) -> int:
    return max(item.sizeHint().width(), item.minimumSize().width())


def _grows(item: QLayoutItem) -> bool:
    return bool(item.expandingDirections() & Qt.Orientation.Horizontal)


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


class EventWatch(QObject):
    """Calls ``slot`` when its widget gets an event of these kinds, such as another font."""

    def __init__(self, widget: QWidget, slot: Callable[[], object], *kinds: QEvent.Type) -> None:
        super().__init__(widget)
        self._slot, self._kinds = slot, kinds
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Call the slot; the widget gets the event, too."""
        if event.type() in self._kinds:
            self._slot()
        return False


_SpinBox = TypeVar("_SpinBox", bound=QAbstractSpinBox)


class WheelFilter(QObject):
    """Leaves the wheel over a box without the focus to what scrolls behind the box."""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the wheel from a box without the focus."""
        if event.type() != QEvent.Type.Wheel or not isinstance(watched, QWidget):
            return False
        if watched.hasFocus():
            return False
        event.ignore()
        return True


def focus_wheel(box: _SpinBox) -> _SpinBox:
    """Return a box that ignores the wheel without the focus, and gets none from the wheel."""
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    box.installEventFilter(WheelFilter(box))
    return box


class ComboBox(QComboBox):
    """A list that the wheel never changes while it is closed: it scrolls what is behind."""

    def __init__(self, parent: QWidget | None = None, **properties: Any) -> None:
        super().__init__(parent, **properties)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the parent."""
        event.ignore()


def copy_rows(table: QTableView) -> None:
    """Copy the selected rows with the names of their columns, as a spreadsheet takes them."""
    model, header = table.model(), table.horizontalHeader()
    order = [header.logicalIndex(place) for place in range(header.count())]
    columns = [column for column in order if not header.isSectionHidden(column)]
    rows = sorted({index.row() for index in table.selectionModel().selectedIndexes()})
    names = [model.headerData(column, Qt.Orientation.Horizontal) for column in columns]
    cells = [[model.index(row, column).data() for column in columns] for row in rows]
    lines = ["\t".join(" ".join(str(c or "").split()) for c in line) for line in (names, *cells)]
    if rows:
        QApplication.clipboard().setText("\n".join(lines))


_Layout = TypeVar("_Layout", bound=QLayout)
_Box = TypeVar("_Box", bound=QBoxLayout)
_Margins = tuple[int, int, int, int]
_NONE = (0, 0, 0, 0)


def group_box(title: str, layout: _Layout) -> tuple[QGroupBox, _Layout]:
    """Return a titled box and the layout inside it."""
    box = QGroupBox(title)
    layout.setContentsMargins(8, 6, 8, 8)
    box.setLayout(layout)
    return box, layout


def vbox(
    *items: QWidget | QLayout, tall: int | None = None, spacing: int = 0, margins: _Margins = _NONE
) -> QVBoxLayout:
    """Return a vertical layout; ``margins`` are left, top, right and bottom.

    The item with the index ``tall`` takes the spare height; −1: none does, it stays below them.
    """
    return _fill(QVBoxLayout(), items, tall, spacing, margins)


def hbox(
    *items: QWidget | QLayout, wide: int = 0, spacing: int = 4, margins: _Margins = _NONE
) -> QHBoxLayout:
    """Return a horizontal layout; the item with the index ``wide`` takes the spare width.

    −1: none does, it stays behind them.
    """
    return _fill(QHBoxLayout(), items, wide, spacing, margins)


def _fill(
    layout: _Box,
    items: tuple[QWidget | QLayout, ...],
    growing: int | None,
    spacing: int,
    margins: _Margins,
) -> _Box:
    layout.setContentsMargins(*margins)
    layout.setSpacing(spacing)
    for item in items:
        if isinstance(item, QWidget):
            layout.addWidget(item)
        else:
            layout.addLayout(item)
    if growing == -1:
        layout.addStretch(1)
    elif growing is not None:
        layout.setStretch(growing, 1)
    return layout


def form_layout(spacing: int) -> QFormLayout:
    """Return a form whose fields take the spare width, or the next line if there is too little."""
    growth = QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow
    wrap = QFormLayout.RowWrapPolicy.WrapLongRows
    layout = QFormLayout(verticalSpacing=spacing, fieldGrowthPolicy=growth, rowWrapPolicy=wrap)
    layout.setContentsMargins(*_NONE)
    return layout


def container(layout: QLayout) -> QWidget:
    """Return a widget that holds a layout."""
    widget = QWidget()
    widget.setLayout(layout)
    return widget


class PanelArea(QScrollArea):
    """Scrolls its panel vertically, and is never narrower than the panel beside a scroll bar."""

    def __init__(self, panel: QWidget) -> None:
        super().__init__(widgetResizable=True)
        self._panel, self._told = panel, QSize()
        self.setWidget(panel)
        self.setFrameShape(QScrollArea.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # Tab leads to the controls in it
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    def minimumSizeHint(self) -> QSize:
        """Return the smallest width that cuts nothing; the height may be less."""
        bar_px = self.verticalScrollBar().sizeHint().width()
        width_px = self._panel.minimumSizeHint().width() + bar_px
        return super().minimumSizeHint().expandedTo(QSize(width_px, 0))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Tell the parent's layout when the panel's contents need another size.

        Most changes are another number in a label: the whole window need not be laid out for them.
        """
        if event.type() == QEvent.Type.LayoutRequest and self._told != self.minimumSizeHint():
            self._told = self.minimumSizeHint()
            self.updateGeometry()
        return super().eventFilter(watched, event)


def scroll_area(widget: QWidget) -> QScrollArea:
    """Return an area that scrolls its widget vertically if the screen is too small for it."""
    return PanelArea(widget)


def scroll_to_top(panel: QWidget) -> None:
    """Show the top of a panel that is in a :func:`scroll_area`."""
    viewport = panel.parentWidget()
    area = viewport.parentWidget() if viewport is not None else None
    if isinstance(area, PanelArea):
        area.verticalScrollBar().setValue(0)


def combo_box(items: dict[str, str]) -> ComboBox:
    """Return a box of texts, each with its data; it may be narrower than its longest text."""
    policy = QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
    box = ComboBox(sizeAdjustPolicy=policy, minimumContentsLength=8)
    for text, data in items.items():
        box.addItem(text, data)
    return box


def push_button(text: str, clicked: Callable[[], object], tooltip: str = "") -> QPushButton:
    """Return a button that calls ``clicked``; one character makes it small."""
    button = QPushButton(text)
    button.setToolTip(tooltip)
    button.clicked.connect(lambda: clicked())
    if len(text) == 1:
        button.setFixedWidth(34)
    return button
