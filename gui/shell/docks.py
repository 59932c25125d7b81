"""The window's frame: pages in the middle, docks around them, and where the focus goes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from PySide6.QtCore import QByteArray, QCoreApplication, QEvent, QObject, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QResizeEvent, QShowEvent
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QMainWindow,
    QScrollArea,
    QStackedWidget,
    QTabWidget,
    QWidget,
)
from shiboken6 import isValid

from gui.widgets.labels import StopButton
from gui.widgets.layouts import container, hbox, vbox
from gui.widgets.theme import scaled_px, text_scale

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
        self.page, self._told = page, (QSize(), QSize())
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
            needs = self.minimumSizeHint(), self.sizeHint()
            if needs != self._told:  # else the whole window is laid out for a number in a label
                self._told = needs
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

    page_added = Signal(object)
    """A page."""

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
        self.page_added.emit(page)

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


_BY_KEY = Qt.FocusReason.ShortcutFocusReason
"""Qt then shows where the focus is; for Tab's reason it does so only while Tab is pressed."""
_REASONS = {True: Qt.FocusReason.TabFocusReason, False: Qt.FocusReason.BacktabFocusReason}


class SteadyFocus(QObject):
    """Rests the focus of a window when its control goes off or disappears; gives it back later.

    Qt moves the focus of a button that goes off to the next one. A second press of the same key
    would then press that: Run after Approach, Abort after Pause.
    """

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        self._left: QWidget | None = None

    def move(self, *, is_next: bool) -> bool:
        """Move the focus to the next control on the screen; from one that has gone, rest it first.

        Return whether there is another control. Qt leads through the panels behind the front one,
        too, where nobody sees the focus.
        """
        focus = self._window.focusWidget()
        if focus is not None and not (focus.isEnabled() and focus.isVisible()):
            self._leave(focus)
            return True
        if focus in (None, self._window) and self._left is not None and isValid(self._left):
            focus = self._left
        found = neighbour_of(self._window, focus, is_next=is_next)
        if found is None:
            return False
        give_focus(found, _REASONS[is_next])
        return True

    def rest(self) -> None:
        """Give the focus to the window itself, where no key presses anything."""
        self._window.setFocus(Qt.FocusReason.OtherFocusReason)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Give the focus back to the control that had it, once it can be used again."""
        left = self._left
        if watched is left and event.type() in (QEvent.Type.EnabledChange, QEvent.Type.Show):
            rests = self._window.focusWidget() in (self._window, None)
            can_be_used = (
                left.isEnabled() and left.isVisible() and left.window() is self._window.window()
            )
            if can_be_used and rests:
                left.setFocus(_BY_KEY)
        return super().eventFilter(watched, event)

    def _leave(self, focus: QWidget) -> None:
        if self._left is not None and isValid(self._left):
            self._left.removeEventFilter(self)
        self._left = focus
        focus.installEventFilter(self)
        self.rest()


class SteadyFocusWindow(QMainWindow):
    """A window with a :class:`SteadyFocus`."""

    def __init__(self) -> None:
        super().__init__()
        self._steady_focus = SteadyFocus(self)

    def focusNextPrevChild(self, is_next: bool) -> bool:
        """Move the focus as :class:`SteadyFocus` does."""
        return self._steady_focus.move(is_next=is_next) or super().focusNextPrevChild(is_next)


class SteadyFocusDock(QDockWidget):
    """A dock that has a :class:`SteadyFocus` of its own while it is a window of its own."""

    def __init__(self, title: str) -> None:
        super().__init__(title)
        self._steady_focus = SteadyFocus(self)
        self.topLevelChanged.connect(self._begin)

    def focusNextPrevChild(self, is_next: bool) -> bool:
        """Move the focus within the floating dock; a docked one leaves that to its window."""
        floats = self.isWindow()
        return (floats and self._steady_focus.move(is_next=is_next)) or super().focusNextPrevChild(
            is_next
        )

    def _begin(self, floats: bool) -> None:
        """Rest the focus of a new window: Qt would give it to the first button."""
        if floats and self.focusWidget() is None:
            self._steady_focus.rest()


def neighbour_of(region: QWidget, start: QWidget | None, *, is_next: bool = True) -> QWidget | None:
    """Return the control of a region that Tab reaches from ``start``, None without one.

    Controls follow each other as they were added, which is how they are laid out.
    """
    controls = region.findChildren(QWidget)
    at = controls.index(start) if start in controls else -1
    after = [*controls[at + 1 :], *controls[: max(at, 0)]]
    window = region.window()  # a floating panel is a window of its own
    found = (
        widget
        for widget in (after if is_next else reversed(after))
        if _takes_tab(widget) and widget.window() is window
    )
    return next(found, None)


def give_focus(widget: QWidget, reason: Qt.FocusReason = _BY_KEY) -> None:
    """Give a widget the focus, and scroll its panel until the widget is in view."""
    widget.setFocus(reason)
    if QApplication.activeWindow() is not None and not widget.isActiveWindow():
        widget.activateWindow()
    area = _above(widget, QScrollArea)
    if isinstance(area, QScrollArea):
        area.ensureWidgetVisible(widget)


def _takes_tab(widget: QWidget) -> bool:
    policy = Qt.FocusPolicy.TabFocus
    can_be_used = widget.isEnabled() and widget.isVisible() and widget.focusProxy() is None
    if not can_be_used or widget.focusPolicy() & policy != policy:
        return False
    dock = _above(widget, QDockWidget)
    return dock is None or not dock.visibleRegion().isEmpty()


def _above(widget: QWidget, kind: type[QWidget]) -> QWidget | None:
    """Return the closest widget of a kind in which a widget is, None without one."""
    above = widget.parentWidget()
    while above is not None and not isinstance(above, kind):
        above = above.parentWidget()
    return above


LAYOUT_VERSION = 1
"""Increased when docks change so much that a saved layout no longer fits."""

_MIDDLE_PX = 590
"""Left to the middle where panels grow with their texts: all plots of the largest texts."""

_STOP_MARGINS_PX = (6, 6, 6, 0)

_Feature = QDockWidget.DockWidgetFeature


class DockArea(QMainWindow):
    """A middle with panels that the user moves, hides, floats and brings back.

    It stands inside the window, so that no docked panel covers what is above or below it.
    """

    panel_used = Signal(str)
    """Name of the panel that came to the front or got the focus."""
    stop_requested = Signal()
    """STOP of a panel that floats, and may cover the window's own."""

    def __init__(self, middle: QWidget) -> None:
        super().__init__()
        self.setWindowFlags(Qt.WindowType.Widget)
        self.setDockNestingEnabled(True)
        self.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        self.setCentralWidget(middle)
        self.docks: dict[str, QDockWidget] = {}
        self._first_layout, self._text_scale = b"", 0.0
        self._asked_px: dict[str, int] = {}
        self._given_px: dict[str, int] = {}
        self._sizes_px: dict[str, tuple[int, Qt.Orientation]] = {}
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        app.focusChanged.connect(self._on_focus_changed)

    def add(
        self,
        name: str,
        title: str,
        widget: QWidget,
        area: Qt.DockWidgetArea,
        *,
        tabbed_with: str = "",
    ) -> QDockWidget:
        """Add a panel at a side, or as a tab beside the panel ``tabbed_with``.

        ``name`` identifies the panel in the saved layout and in :meth:`show_panel`.
        """
        dock = SteadyFocusDock(title)
        dock.setObjectName(name)
        dock.setWidget(self._below_stop(dock, widget))
        self.addDockWidget(area, dock)
        if tabbed_with:
            self.tabifyDockWidget(self.docks[tabbed_with], dock)
        self.docks[name] = dock
        dock.visibilityChanged.connect(partial(self._on_visibility_changed, name))
        dock.topLevelChanged.connect(lambda _: QTimer.singleShot(0, self, self._raise_floating))
        return dock

    def _below_stop(self, dock: QDockWidget, widget: QWidget) -> QWidget:
        """Return a panel with a STOP above it, which shows while the panel floats."""
        stop = StopButton()
        stop.pressed.connect(self.stop_requested)
        bar = container(hbox(stop, wide=0, margins=_STOP_MARGINS_PX))
        bar.hide()
        dock.topLevelChanged.connect(bar.setVisible)
        column = vbox(bar, widget, tall=1)
        return container(column)

    def keep_on_screen(self, name: str) -> None:
        """Let a panel move to another side, but neither close nor float."""
        self.docks[name].setFeatures(
            _Feature.DockWidgetMovable | _Feature.DockWidgetVerticalTitleBar
        )

    def set_first_size(self, name: str, size_px: int, orientation: Qt.Orientation) -> None:
        """Give a panel its width or height in the layout that no user has changed."""
        self._sizes_px[name] = size_px, orientation

    def show_panel(self, name: str) -> None:
        """Show a panel in front of its tabs."""
        dock = self.docks[name]
        dock.show()
        dock.raise_()
        self.panel_used.emit(name)

    def side_widths_px(self) -> dict[str, int]:
        """Return the widths of the panels at the left and right, of tabs that of the front one."""
        sides = (Qt.DockWidgetArea.LeftDockWidgetArea, Qt.DockWidgetArea.RightDockWidgetArea)
        return {
            name: dock.width()
            for name, dock in self.docks.items()
            if self.dockWidgetArea(dock) in sides
            and not (dock.isFloating() or dock.isHidden() or dock.visibleRegion().isEmpty())
        }

    def asked_widths_px(self) -> dict[str, int]:
        """Return the widths at the sides: as asked where nobody changed what there was room for."""
        return {
            name: self._asked_px[name] if px == self._given_px.get(name) else px
            for name, px in self.side_widths_px().items()
        }

    def set_side_widths(self, widths_px: Mapping[str, int]) -> None:
        """Give panels their widths, as far as the texts in them and in the middle allow."""
        # The panels still ask for the room of the texts before; a dock would not get narrower.
        QCoreApplication.sendPostedEvents(None, QEvent.Type.LayoutRequest)
        self._asked_px, self._given_px = dict(widths_px), {}
        QTimer.singleShot(0, self, self._note_given)
        docks = [self.docks[name] for name in widths_px]
        share = min(1.0, (self.width() - _MIDDLE_PX) / max(sum(widths_px.values()), 1))
        sizes_px = [max(1, int(px * share)) for px in widths_px.values()]
        self.resizeDocks(docks, sizes_px, Qt.Orientation.Horizontal)

    def reset(self) -> None:
        """Return to the layout of the first start."""
        self.restore(self._first_layout)
        self._take_first_sizes()

    def save(self) -> bytes:
        """Return the layout."""
        return bytes(self.saveState(LAYOUT_VERSION).data())

    def restore(self, layout: bytes) -> bool:
        """Apply a saved layout; return whether it fits."""
        self._keep_first()
        return self.restoreState(QByteArray(layout), LAYOUT_VERSION)

    def showEvent(self, event: QShowEvent) -> None:
        """Give the panels their first sizes, which need a window on the screen."""
        super().showEvent(event)
        if not self._first_layout:
            self._take_first_sizes()
            self._keep_first()
            QTimer.singleShot(0, self, self._take_first_sizes)  # a page has its width only then
        self._text_scale = self._text_scale or text_scale()
        if self._text_scale != text_scale():  # another rig's page was in front of this one
            QTimer.singleShot(0, self, lambda: self.follow_texts(self.asked_widths_px()))
        self._raise_floating()

    def follow_texts(self, widths_px: Mapping[str, int]) -> None:
        """Give panels the widths that they had, in proportion to the new size of the texts."""
        factor = text_scale() / (self._text_scale or text_scale())
        self._text_scale = text_scale()
        self.set_side_widths({name: round(px * factor) for name, px in widths_px.items()})

    def _keep_first(self) -> None:
        """Keep the layout that no user has changed, for :meth:`reset`."""
        self._first_layout = self._first_layout or self.save()

    def _take_first_sizes(self) -> None:
        for name, (size_px, orientation) in self._sizes_px.items():
            self.resizeDocks([self.docks[name]], [scaled_px(size_px)], orientation)

    def _raise_floating(self) -> None:
        """Keep panels that float before the window, also those of a layout that was restored."""
        handle = self.window().windowHandle()
        for dock in self.docks.values():
            floating = dock.windowHandle() if dock.isWindow() and dock.isVisible() else None
            if floating is not None and handle is not None:
                floating.setTransientParent(handle)
                dock.raise_()

    def _note_given(self) -> None:
        widths_px = self.side_widths_px()
        self._given_px = {name: widths_px[name] for name in self._asked_px if name in widths_px}

    def _on_visibility_changed(self, name: str, is_visible: bool) -> None:
        if is_visible:
            self.panel_used.emit(name)

    def _on_focus_changed(self, _: QWidget | None, now: QWidget | None) -> None:
        for name, dock in self.docks.items():
            if now is not None and dock.isAncestorOf(now):
                self.panel_used.emit(name)
