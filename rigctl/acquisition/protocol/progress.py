"""How far a run has come and how long the rest will take, from the pace it really had."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.values import PlannedTrial


class RunProgress:
    """Counts trials. Times are loop time, s; a resumed run starts with what was done before."""

    def __init__(
        self, trials: Iterable[PlannedTrial], done: frozenset[int], planned_s: float, now_s: float
    ) -> None:
        every = tuple(trials)
        left = [trial for trial in every if trial.trial_id not in done]
        self.planned = len(every)
        self.committed = self.planned - len(left)
        self.rejected = 0
        self._started_s = now_s
        self._left = len(left)
        self._windows_left_s = sum(trial.duration_s for trial in left)
        windows_s = sum(trial.duration_s for trial in every)
        self._overhead_s = max(0.0, planned_s - windows_s) / max(1, self.planned)
        self._taken = 0
        self._windows_taken_s = 0.0
        self._idle_s = 0.0

    def commit(self, trial: PlannedTrial) -> None:
        """That trial is done."""
        self.committed += 1
        self.end(trial)

    def end(self, trial: PlannedTrial) -> None:
        """That trial will not be tried again, good or not."""
        self._left -= 1
        self._taken += 1
        self._windows_left_s -= trial.duration_s
        self._windows_taken_s += trial.duration_s

    def idle(self, seconds: float) -> None:
        """Nothing was done for so long: a pause or a question says nothing about the pace."""
        self._idle_s += seconds

    def elapsed_s(self, now_s: float) -> float:
        """Time since the start, pauses included."""
        return now_s - self._started_s

    def eta_s(self, now_s: float) -> float:
        """Time that the rest will take."""
        overhead_s = self._overhead_s
        if self._taken:
            busy_s = self.elapsed_s(now_s) - self._idle_s - self._windows_taken_s
            overhead_s = max(0.0, busy_s / self._taken)
        return max(0.0, self._windows_left_s + self._left * overhead_s)
