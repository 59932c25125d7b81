"""The mode in which each new trial begins at the left edge of the live plots."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QCheckBox, QWidget

from gui.live.earlier_trials import BIN_S, MOST, TrialStarts, TrialSweep, condition_of
from gui.live.live_plots import LivePlots
from gui.live.spike_rates import FULL_SCALE_HZ
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import vbox
from gui.widgets.number_box import WholeNumberBox
from rigctl.acquisition.rpc.messages import EngineStatus

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


class SweepMode(QObject):
    """Finds trials in the samples as they come, and aligns the plots if the strip says so."""

    def __init__(self, plots: LivePlots, strip: SweepStrip) -> None:
        super().__init__(plots)
        self._plots, self._strip = plots, strip
        self.starts = TrialStarts()
        self.taxel = 0
        strip.changed.connect(self._apply)

    def show_status(self, status: EngineStatus) -> None:
        """Take the condition of the trial that begins next."""
        self.starts.condition = condition_of(status)

    def show_taxel(self, taxel: int) -> None:
        """Show earlier readings and rates of another taxel, from 0."""
        self.taxel = taxel
        self._apply()

    def follow(self) -> None:
        """Take new samples; begin anew at the left where a trial began."""
        timeline, navigation = self._plots.data.timeline, self._plots.navigation
        self.starts.follow(timeline)
        if not self._strip.align.isChecked() or navigation.is_paused:
            return
        trial = self._present()
        if navigation.trial_start != (None if trial is None else trial.start):
            self._align(trial)

    def _present(self) -> TrialSweep | None:
        return self.starts.newest(self._plots.data.timeline.oldest)

    def _apply(self) -> None:
        if not self._strip.align.isChecked():
            self._align(None)
        elif not self._plots.navigation.is_paused or self._plots.navigation.trial_start is None:
            self._align(self._present())
        else:
            self._align(self._shown())
        self._plots.draw()

    def _shown(self) -> TrialSweep | None:
        """Return the trial that a look back shows."""
        start = self._plots.navigation.trial_start
        return next((trial for trial in self.starts.trials if trial.start == start), None)

    def _align(self, trial: TrialSweep | None) -> None:
        plots = self._plots
        oldest, count = plots.data.timeline.oldest, self._strip.count.value()
        earlier = [] if trial is None else self.starts.before(trial, count, oldest)
        plots.navigation.align_to(None if trial is None else trial.start)
        plots.show_earlier(earlier, self.taxel)
        condition = None if trial is None else str(trial.condition)
        self._strip.show_state(condition, len(earlier), self.taxel)
