"""Choose whether each trial begins at the left edge, and how many earlier ones stand behind it."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QWidget

from gui.live.spikes.spike_rates import FULL_SCALE_HZ
from gui.live.sweeps.earlier_trials import BIN_S, MOST
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import vbox
from gui.widgets.number_box import WholeNumberBox

OFF = "The time axis scrolls with the newest samples."
WAITS = "No trial has begun yet: the time axis scrolls until the sync line rises."


class SweepStrip(QWidget):
    """``align``: the mode's switch; ``count``: the number of earlier trials."""

    changed = Signal()
    """Another mode or number."""

    def __init__(self) -> None:
        super().__init__()
        self.align = QCheckBox("begin each trial at the left")
        self.align.setToolTip("t = 0 is the first sample of the trial, as the session cuts it")
        self.count = WholeNumberBox(minimum=0, maximum=MOST, value=5)
        self.count.setToolTip(
            "Whole trials of the same plate, speed and force, in faint lines: force, speed, the\n"
            "readings of the chosen taxel, and in its rows of the raster the mean rate of its\n"
            f"neurons in bins of {1000 * BIN_S:.0f} ms"
        )
        self.count.setAccessibleName("Earlier trials behind the present one")
        self.sentence = ElidedLabel(OFF, "muted")
        row = FlowLayout(self.align, label("earlier trials"), self.count)
        self.setLayout(vbox(row, self.sentence, spacing=2, margins=(6, 0, 6, 0)))
        self.align.toggled.connect(lambda _: self.changed.emit())
        self.count.valueChanged.connect(lambda _: self.changed.emit())

    def show_state(self, condition: str | None, n_earlier: int, taxel: int) -> None:
        """Say what is shown: the condition of the present trial, None before the first one."""
        show_text(self.sentence, self._words(condition, n_earlier, taxel))

    def _words(self, condition: str | None, n_earlier: int, taxel: int) -> str:
        if not self.align.isChecked():
            return OFF
        if condition is None:
            return WAITS
        words = f"{condition}; faint: {n_earlier} earlier"
        if not n_earlier:
            return words
        rate = f"mean rate, 0–{FULL_SCALE_HZ:.0f} Hz"
        return f"{words}; line in the raster rows of T{taxel + 1}: {rate}"
