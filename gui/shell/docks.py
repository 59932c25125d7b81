"""Panels around the middle of the window, as Qt's own docks."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from PySide6.QtCore import QByteArray, QCoreApplication, QEvent, Qt, QTimer, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QApplication, QDockWidget, QMainWindow, QTabWidget, QWidget

from gui.shell.steady_focus import SteadyFocusDock
from gui.widgets.labels import StopButton
from gui.widgets.layouts import container, hbox, vbox

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
        self._first_layout = b""
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
        return dock

    def _below_stop(self, dock: QDockWidget, widget: QWidget) -> QWidget:
        """Return a panel with a STOP above it, which shows while the panel floats."""
        stop = StopButton()
        stop.pressed.connect(self.stop_requested)
        bar = container(hbox(stop, wide=0, margins=_STOP_MARGINS_PX))
        bar.hide()
        dock.topLevelChanged.connect(bar.setVisible)
        column = vbox(bar, widget)
        column.setStretch(1, 1)
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

    def save(self) -> bytes:
        """Return the layout."""
        return bytes(self.saveState(LAYOUT_VERSION).data())

    def restore(self, layout: bytes) -> bool:
        """Apply a saved layout; return whether it fits."""
        return self.restoreState(QByteArray(layout), LAYOUT_VERSION)

    def showEvent(self, event: QShowEvent) -> None:
        """Give the panels their first sizes, which need a window on the screen."""
        super().showEvent(event)
        sizes, self._sizes_px = self._sizes_px, {}
        for name, (size_px, orientation) in sizes.items():
            self.resizeDocks([self.docks[name]], [size_px], orientation)
        if sizes:
            self._first_layout = self.save()

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
