"""The controls of the live plots: pause, span, unit, the strips, and the place in time."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QComboBox, QPushButton, QScrollBar, QWidget

from gui.live.review.navigation import SPANS_S, Navigation
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button, vbox

COUNTS, VOLTS, CONDUCTANCE = "counts", "volts", "conductance"
_STEP = 10  # samples in one step of the scroll bar, whose numbers have 32 bits


class LiveBar(QWidget):
    """Controls of a navigation; ``strips``: names of buttons that show a strip each."""

    strip_toggled = Signal(str, bool)
    """The name of a strip's button, and whether the strip is to be shown."""

    def __init__(self, navigation: Navigation, strips: dict[str, str]) -> None:
        super().__init__()
        self._navigation = navigation
        self.pause = push_button("Pause", self._toggle, "Look back while samples go on (Space)")
        self.span = QComboBox()
        for span_s in SPANS_S:
            self.span.addItem(f"{span_s} s", span_s)
        self.span.setToolTip("Length of the time axis (+ and −)")
        self.unit = QComboBox()
        self.unit.addItems([COUNTS, VOLTS, CONDUCTANCE])
        self.unit.setToolTip(
            "Unit of the readings. Conductance is free of the load of the other taxels of an\n"
            "input, in multiples of the divider's; the encoder of the strip takes it, too"
        )
        self.buttons = {name: self._strip_button(name, tip) for name, tip in strips.items()}
        self.scroll_bar = QScrollBar(Qt.Orientation.Horizontal)
        self.scroll_bar.setAccessibleName("Place in the last minutes")
        self.place = label("live", "muted")
        self.place.setMinimumWidth(self.place.fontMetrics().horizontalAdvance("10:00 min ago"))
        first = FlowLayout(self.pause, self.span, self.unit, *self.buttons.values())
        self.setLayout(vbox(first, hbox(self.scroll_bar, self.place), spacing=3))
        self.span.activated.connect(lambda _: navigation.set_span(self.span.currentData()))
        self.scroll_bar.valueChanged.connect(self._move)
        navigation.changed.connect(self.show_place)
        self.show_place()

    def show_place(self) -> None:
        """Show where the views look."""
        navigation = self._navigation
        window, is_paused = navigation.window, navigation.is_paused
        self.pause.setText("Live" if is_paused else "Pause")
        with QSignalBlocker(self.scroll_bar):
            room = max(navigation.newest - window.span - navigation.oldest, 0)
            self.scroll_bar.setRange(0, room // _STEP)
            self.scroll_bar.setPageStep(max(1, window.span // _STEP))
            self.scroll_bar.setSingleStep(max(1, window.span // _STEP // 10))
            self.scroll_bar.setValue((window.left - navigation.oldest) // _STEP)
        behind_s = (navigation.newest - window.right) / 1000
        minutes, seconds = divmod(round(behind_s), 60)
        self.place.setText(f"{minutes}:{seconds:02d} min ago" if is_paused else "live")
        if (index := self.span.findData(navigation.span_s)) >= 0:
            self.span.setCurrentIndex(index)

    def close_strips(self, except_for: str = "") -> None:
        """Release the buttons of all strips but one."""
        for name, button in self.buttons.items():
            if name != except_for and button.isChecked():
                button.setChecked(False)

    def _strip_button(self, name: str, tip: str) -> QPushButton:
        button = QPushButton(name)
        button.setCheckable(True)
        button.setToolTip(tip)
        button.toggled.connect(lambda is_on: self.strip_toggled.emit(name, is_on))
        return button

    def _toggle(self) -> None:
        navigation = self._navigation
        (navigation.resume if navigation.is_paused else navigation.pause)()

    def _move(self, value: int) -> None:
        navigation = self._navigation
        navigation.pause()
        navigation.move_to(navigation.oldest + value * _STEP + navigation.window.span)
        navigation.changed.emit()
