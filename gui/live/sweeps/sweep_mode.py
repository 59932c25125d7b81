"""The mode in which each new trial begins at the left edge of the live plots."""

from __future__ import annotations

from PySide6.QtCore import QObject

from gui.live.live_plots import LivePlots
from gui.live.sweeps.sweep_strip import SweepStrip
from gui.live.sweeps.trial_starts import TrialStarts, TrialSweep, condition_of
from rigctl.acquisition.rpc.messages import EngineStatus


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
