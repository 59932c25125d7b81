"""Progress of a run and its remaining time, from the pace so far."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.values import PlannedTrial


class RunProgress:
    """Counts trials. Times are loop time; a resumed run starts with the trials committed before.

    ``idle_s``: pauses and questions, which the pace excludes.
    """

    def __init__(
        self, trials: Sequence[PlannedTrial], done: frozenset[int], planned_s: float, now_s: float
    ) -> None:
        remaining = [trial for trial in trials if trial.trial_id not in done]
        self.planned = len(trials)
        self.committed = self.planned - len(remaining)
        self.rejected = 0
        self.idle_s = 0.0
        self._started_s = now_s
        self._remaining = len(remaining)
        self._remaining_windows_s = sum(trial.duration_s for trial in remaining)
        planned_windows_s = sum(trial.duration_s for trial in trials)
        self._overhead_s = max(0.0, planned_s - planned_windows_s) / max(1, self.planned)
        self._finished = 0
        self._finished_windows_s = 0.0

    def commit(self, trial: PlannedTrial) -> None:
        """Count a committed trial."""
        self.committed += 1
        self.finish(trial)

    def finish(self, trial: PlannedTrial) -> None:
        """Count a trial that will not be tried again, good or not."""
        self._remaining -= 1
        self._finished += 1
        self._remaining_windows_s -= trial.duration_s
        self._finished_windows_s += trial.duration_s

    def elapsed_s(self, now_s: float) -> float:
        """Return the time since the start, pauses included."""
        return now_s - self._started_s

    def eta_s(self, now_s: float) -> float:
        """Return the estimated remaining time."""
        overhead_s = self._overhead_s
        if self._finished:
            busy_s = self.elapsed_s(now_s) - self.idle_s - self._finished_windows_s
            overhead_s = max(0.0, busy_s / self._finished)
        return max(0.0, self._remaining_windows_s + self._remaining * overhead_s)
