"""Progress of a run of the moving finger: its scans, how they were named, the remaining time."""

from __future__ import annotations

from collections.abc import Callable, Collection

from rigctl.engine.progress import RunClock
from rigctl.finger.plan import SECONDS_PER_TRIAL, FingerPlan


class FingerProgress:
    """Counts scans, and which of them were named correctly.

    ``now_s`` returns loop time. Pauses and questions do not count for the pace.
    """

    def __init__(
        self,
        plan: FingerPlan,
        done: frozenset[int],
        now_s: Callable[[], float],
        rejected: int = 0,
    ) -> None:
        self.clock = RunClock(now_s)
        self.planned = len(plan.trials)
        self.committed = len(done)
        self.rejected = rejected
        self.textures, self.quality = plan.protocol.textures, plan.protocol.quality
        self.confusion = {true: dict.fromkeys(self.textures, 0) for true in self.textures}
        self._remaining = self.planned - self.committed
        self._finished = 0
        self._finished_s = 0.0

    def commit(self) -> None:
        """Count a committed scan."""
        self.committed += 1
        self.finish()

    def finish(self) -> None:
        """Count a scan that will not be tried again, good or not."""
        self._remaining -= 1
        self._finished += 1
        self._finished_s = self.clock.busy_s

    def reopen(self, committed: frozenset[int], given_up: Collection[int]) -> None:
        """Count again after a disk refused: these scans are on it, and these are given up."""
        self.committed = len(committed)
        self._remaining = self.planned - self.committed - len(given_up)

    def classify(self, true: str, predicted: str) -> None:
        """Count a scan and the texture that the classifier named."""
        named = self.confusion[true]
        named[predicted] = named.get(predicted, 0) + 1

    @property
    def classified(self) -> int:
        """Number of classified scans."""
        return sum(sum(named.values()) for named in self.confusion.values())

    @property
    def correct(self) -> int:
        """Number of scans that were named correctly."""
        return sum(named[true] for true, named in self.confusion.items())

    def eta_s(self) -> float:
        """Return the estimated remaining time, from the pace so far."""
        each_s = SECONDS_PER_TRIAL
        if self._finished:
            each_s = self._finished_s / self._finished
        return self._remaining * each_s
