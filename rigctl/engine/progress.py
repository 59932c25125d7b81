"""Progress of a run: its clock, its trials, and the remaining time from the pace so far."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from rigctl.values import PlannedTrial


class RunClock:
    """Times since the start of a sitting, in loop time that ``now_s`` returns."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self.now_s = now_s
        self._started_s = now_s()
        self._idle_s = 0.0
        self._idle_since_s: float | None = None

    @property
    def elapsed_s(self) -> float:
        """The time since the start, pauses and questions included."""
        return self.now_s() - self._started_s

    @property
    def busy_s(self) -> float:
        """The time since the start without pauses and questions, the present one included."""
        since_s = self._idle_since_s
        present_s = 0.0 if since_s is None else self.now_s() - since_s
        return self.elapsed_s - self._idle_s - present_s

    @contextmanager
    def idle(self) -> Iterator[None]:
        """Count the time of the block as a pause or a question."""
        outer = self._idle_since_s is not None
        if outer:
            yield
            return
        self._idle_since_s = since_s = self.now_s()
        try:
            yield
        finally:
            self._idle_s += self.now_s() - since_s
            self._idle_since_s = None


MIN_PACED_TRIALS = 2
"""Trials before the pace replaces the plan's."""


class RunProgress:
    """Counts trials; a resumed run starts with the trials committed before.

    ``ended``: trials that an early end left out. ``now_s`` returns loop time. Pauses and questions
    do not count for the pace.
    """

    def __init__(
        self,
        trials: Sequence[PlannedTrial],
        done: frozenset[int],
        planned_s: float,
        now_s: Callable[[], float],
        ended: frozenset[int] = frozenset(),
    ) -> None:
        gone = done | ended
        remaining = [trial for trial in trials if trial.trial_id not in gone]
        self.clock = RunClock(now_s)
        self.planned = len(trials)
        self.committed = len(done)
        self.rejected = 0
        self.ended_early = len(ended)
        self._remaining = len(remaining)
        self._remaining_windows_s = sum(trial.duration_s for trial in remaining)
        planned_windows_s = sum(trial.duration_s for trial in trials)
        self._overhead_s = max(0.0, planned_s - planned_windows_s) / max(1, self.planned)
        self._finished = 0
        self._paced_s = 0.0
        self._last_busy_s = 0.0
        self._committed_at_s: float | None = None

    def commit(self, trial: PlannedTrial) -> None:
        """Count a committed trial."""
        self.committed += 1
        self._committed_at_s = self.clock.now_s()
        self.finish(trial)

    def finish(self, trial: PlannedTrial) -> None:
        """Count a trial that will not be tried again, good or not; its time sets the pace."""
        self._leave_out([trial])
        busy_s = self.clock.busy_s
        if self._finished:  # the first one follows homing and tare
            self._paced_s += busy_s - self._last_busy_s - trial.duration_s
        self._finished += 1
        self._last_busy_s = busy_s

    def skip(self, trial: PlannedTrial, *, was_in_hand: bool) -> None:
        """Count a trial as not to come, whose time says nothing of the pace."""
        self._leave_out([trial])
        if was_in_hand:
            self._last_busy_s = self.clock.busy_s

    def end_early(self, trials: Sequence[PlannedTrial]) -> None:
        """Count trials as not needed: their condition has ended."""
        self.ended_early += len(trials)
        self._leave_out(trials)

    def _leave_out(self, trials: Sequence[PlannedTrial]) -> None:
        self._remaining -= len(trials)
        self._remaining_windows_s -= sum(trial.duration_s for trial in trials)

    @property
    def missing(self) -> int:
        """Trials of the plan that neither count nor were left out by an early end."""
        return self.planned - self.committed - self.ended_early

    def reopen(self, trial: PlannedTrial, *, was_committed: bool) -> None:
        """Count a finished trial as one that is to come."""
        self.committed -= was_committed
        self._remaining += 1
        self._remaining_windows_s += trial.duration_s

    def idle(self) -> AbstractContextManager[None]:
        """Return a context whose time is a pause or a question."""
        return self.clock.idle()

    def trial_age_s(self) -> float | None:
        """Return the time since a trial was committed, None before one was in this sitting."""
        since_s = self._committed_at_s
        return None if since_s is None else self.clock.now_s() - since_s

    def eta_s(self) -> float:
        """Return the estimated remaining time, without the questions that are still to come."""
        return max(0.0, self._remaining_windows_s + self._remaining * self._overhead_each_s())

    def duration_of_s(self, trials: Iterable[PlannedTrial]) -> float:
        """Return the estimated time of trials that are still to come."""
        overhead_s = self._overhead_each_s()
        return sum(trial.duration_s + overhead_s for trial in trials)

    def _overhead_each_s(self) -> float:
        if self._finished < MIN_PACED_TRIALS:
            return self._overhead_s
        return max(0.0, self._paced_s / (self._finished - 1))
