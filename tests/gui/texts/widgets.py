"""The texts of each kind of widget, measured with the widget's own style and font."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QFontMetrics
from PySide6.QtWidgets import (
    QAbstractItemView,
    QAbstractSpinBox,
    QCheckBox,
    QComboBox,
    QDockWidget,
    QDoubleSpinBox,
    QGroupBox,
    QHeaderView,
    QLabel,
    QLineEdit,
    QListView,
    QMenuBar,
    QProgressBar,
    QPushButton,
    QRadioButton,
    QSpinBox,
    QStyle,
    QStyleOptionButton,
    QStyleOptionComboBox,
    QStyleOptionDockWidget,
    QStyleOptionGroupBox,
    QStyleOptionSpinBox,
    QStyleOptionTab,
    QTabBar,
    QToolButton,
    QWidget,
)

from gui.widgets.file_browser import ElidedComboBox
from gui.widgets.labels import ElidedLabel, plain_tooltip
from tests.gui.texts.piece import Piece

_Element, _Control, _Part = QStyle.SubElement, QStyle.ComplexControl, QStyle.SubControl
_CURSOR_PX = 2
_WRAP = int(Qt.TextFlag.TextWordWrap)


def pieces(widget: QWidget) -> list[Piece]:
    """Return the texts that a widget shows itself, without those of its children."""
    for kind, measure in _MEASURES.items():
        if isinstance(widget, kind):
            return [piece for piece in measure(widget) if piece.text.strip()]
    return []


def _size(widget: QWidget, text: str) -> QSize:
    """Return the width of a line of text and the height of its ink."""
    metrics = QFontMetrics(widget.font())
    width = metrics.size(Qt.TextFlag.TextShowMnemonic, text).width()
    return QSize(width, metrics.tightBoundingRect(text).height())


def _label(label: QLabel) -> Iterator[Piece]:
    """Measure a label; one line may be shortened where its tooltip has the whole text."""
    if isinstance(label, ElidedLabel) and label.toolTip() == plain_tooltip(label.text()):
        yield Piece(label.shown_text, _size(label, label.shown_text), label.rect())
        return
    if label.wordWrap():
        room = QRect(0, 0, label.contentsRect().width(), 1 << 20)
        widest = QFontMetrics(label.font()).boundingRect(room, _WRAP, label.text()).width()
        needs = QSize(widest, label.heightForWidth(label.width()))
    elif "\n" in label.text() or label.textFormat() is not Qt.TextFormat.PlainText:
        needs = label.sizeHint()
    else:
        needs = QSize(label.sizeHint().width(), _size(label, label.text()).height())
    yield Piece(label.text(), needs, label.rect())


def _push_button(button: QPushButton) -> Iterator[Piece]:
    option = QStyleOptionButton()
    button.initStyleOption(option)
    place = button.style().subElementRect(_Element.SE_PushButtonContents, option, button)
    needs = _size(button, button.text())
    if not button.icon().isNull():
        needs.setWidth(needs.width() + button.iconSize().width() + 4)
    yield Piece(button.text(), needs, place)


def _check_box(button: QCheckBox | QRadioButton) -> Iterator[Piece]:
    option = QStyleOptionButton()
    button.initStyleOption(option)
    is_radio = isinstance(button, QRadioButton)
    element = _Element.SE_RadioButtonContents if is_radio else _Element.SE_CheckBoxContents
    place = button.style().subElementRect(element, option, button)
    yield Piece(button.text(), _size(button, button.text()), place)


def _tool_button(button: QToolButton) -> Iterator[Piece]:
    style = button.toolButtonStyle()
    shows_icon_only = style is Qt.ToolButtonStyle.ToolButtonIconOnly
    if shows_icon_only and not button.icon().isNull():
        return
    if button.arrowType() is Qt.ArrowType.NoArrow:
        yield Piece(button.text(), _size(button, button.text()), button.rect())


def _group_box(box: QGroupBox) -> Iterator[Piece]:
    option = QStyleOptionGroupBox()
    box.initStyleOption(option)
    style = box.style()
    place = style.subControlRect(
        _Control.CC_GroupBox, option, _Part.SC_GroupBoxLabel, box
    ).intersected(box.rect())
    needs = _size(box, box.title())
    ink = QFontMetrics(box.font()).boundingRect(box.title())
    needs.setWidth(ink.right() + 1)  # Qt gives the title the width of its ink, not of its advance
    yield Piece(box.title(), needs, place)


def _tab_bar(bar: QTabBar) -> Iterator[Piece]:
    for index in range(bar.count()):
        if not bar.isTabVisible(index):
            continue
        option = QStyleOptionTab()
        bar.initStyleOption(option, index)
        place = bar.style().subElementRect(_Element.SE_TabBarTabText, option, bar)
        shown = place.intersected(bar.rect())
        text = bar.tabText(index)
        upright = bar.shape() in (QTabBar.Shape.RoundedWest, QTabBar.Shape.RoundedEast)
        needs = _size(bar, text)
        yield Piece(text, needs.transposed() if upright else needs, shown, option.text != text)


def _combo_box(box: QComboBox) -> Iterator[Piece]:
    """Measure all choices, each of which may be chosen; one that ends in … has a tooltip.

    Qt's file dialog shortens a long folder itself.
    """
    if box.objectName() == "lookInCombo" and box.currentText() == box.toolTip():
        return
    option = QStyleOptionComboBox()
    box.initStyleOption(option)
    style = box.style()
    if isinstance(box, ElidedComboBox) and box.currentText() in box.toolTip():
        yield Piece(box.shown_text(), _size(box, box.shown_text()), box.rect())
        return
    place = style.subControlRect(_Control.CC_ComboBox, option, _Part.SC_ComboBoxEditField, box)
    for index in range(box.count()):
        yield Piece(box.itemText(index), _size(box, box.itemText(index)), place)


def _spin_box(box: QAbstractSpinBox) -> Iterator[Piece]:
    option = QStyleOptionSpinBox()
    box.initStyleOption(option)
    style = box.style()
    place = style.subControlRect(_Control.CC_SpinBox, option, _Part.SC_SpinBoxEditField, box)
    place.adjust(_CURSOR_PX, 0, -_CURSOR_PX, 0)
    for text in {box.text(), *_bounds(box)}:
        yield Piece(text, _size(box, text), place)


def _bounds(box: QAbstractSpinBox) -> list[str]:
    """Return the texts of the lowest and the highest number."""
    if isinstance(box, QSpinBox):
        texts = [box.textFromValue(n) for n in (box.minimum(), box.maximum())]
    elif isinstance(box, QDoubleSpinBox):
        texts = [box.textFromValue(x) for x in (box.minimum(), box.maximum())]
    else:
        return []
    return [f"{box.prefix()}{text}{box.suffix()}" for text in texts]


def _line_edit(edit: QLineEdit) -> Iterator[Piece]:
    """Measure what the cursor cannot reach: the hint in an empty field, a field without focus."""
    if isinstance(edit.parentWidget(), QAbstractSpinBox | QComboBox):
        return
    has_cursor = edit.focusPolicy() is not Qt.FocusPolicy.NoFocus
    text = edit.placeholderText() if not edit.text() else "" if has_cursor else edit.text()
    place = edit.contentsRect().adjusted(_CURSOR_PX, 0, -_CURSOR_PX, 0)
    yield Piece(text, _size(edit, text), place)


def _progress_bar(bar: QProgressBar) -> Iterator[Piece]:
    if bar.isTextVisible():
        yield Piece(bar.text(), _size(bar, bar.text()), bar.rect())


def _header(header: QHeaderView) -> Iterator[Piece]:
    model = header.model()
    is_flat = header.orientation() is Qt.Orientation.Horizontal
    for visual in range(header.count()):
        section = header.logicalIndex(visual)
        length, start = header.sectionSize(section), header.sectionViewportPosition(section)
        if not 0 <= start < (header.width() if is_flat else header.height()) or not length:
            continue
        text = str(model.headerData(section, header.orientation()) or "")
        hint = header.sectionSizeHint(section)
        needs = QSize(hint, 0) if is_flat else QSize(0, hint)
        place = QRect(start, 0, length, header.height())
        yield Piece(text, needs, place if is_flat else QRect(0, start, header.width(), length))


def _item_view(view: QAbstractItemView) -> Iterator[Piece]:
    """Measure the cells in sight; a view may be scrolled to the rest."""
    model, root = view.model(), view.rootIndex()
    if model is None:
        return
    port = view.viewport().rect()
    for row in range(model.rowCount(root)):
        for column in range(1 if isinstance(view, QListView) else model.columnCount(root)):
            index = model.index(row, column, root)
            place = view.visualRect(index)
            if place.isEmpty() or not port.intersects(place):
                continue
            text = str(index.data(Qt.ItemDataRole.DisplayRole) or "")
            needs = view.sizeHintForIndex(index)
            if isinstance(view, QListView) and view.wordWrap():
                metrics = QFontMetrics(view.font())
                needs = metrics.boundingRect(place.adjusted(0, 0, 0, 1 << 20), _WRAP, text).size()
            yield Piece(text, needs, place)
        if view.visualRect(model.index(row, 0, root)).top() > port.bottom():
            return


def _menu_bar(bar: QMenuBar) -> Iterator[Piece]:
    for action in bar.actions():
        if action.isVisible():
            place = bar.actionGeometry(action).intersected(bar.rect())
            yield Piece(action.text(), _size(bar, action.text()), place)


def _dock(dock: QDockWidget) -> Iterator[Piece]:
    if dock.titleBarWidget() is not None:
        return
    option = QStyleOptionDockWidget()
    dock.initStyleOption(option)
    place = dock.style().subElementRect(_Element.SE_DockWidgetTitleBarText, option, dock)
    needs = _size(dock, dock.windowTitle())
    is_upright = QDockWidget.DockWidgetFeature.DockWidgetVerticalTitleBar in dock.features()
    yield Piece(dock.windowTitle(), needs.transposed() if is_upright else needs, place)


_MEASURES: dict[type[QWidget], Callable[[Any], Iterator[Piece]]] = {
    QLabel: _label,
    QPushButton: _push_button,
    QCheckBox: _check_box,
    QRadioButton: _check_box,
    QToolButton: _tool_button,
    QGroupBox: _group_box,
    QTabBar: _tab_bar,
    QComboBox: _combo_box,
    QAbstractSpinBox: _spin_box,
    QLineEdit: _line_edit,
    QProgressBar: _progress_bar,
    QHeaderView: _header,
    QAbstractItemView: _item_view,
    QMenuBar: _menu_bar,
    QDockWidget: _dock,
}
