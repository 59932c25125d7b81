"""Where trials begin and end in the live samples. This module does not import Qt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gui.live.store.timeline import Timeline
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.taxels.frames import Flag

KEPT = 200


class Condition(NamedTuple):
    """What earlier trials must share to be comparable."""

    plate: str
    speed_mm_s: float
    force_g: float

    def __str__(self) -> str:
        return f"plate {self.plate or '?'}, {self.speed_mm_s:g} mm/s, {self.force_g:g} g"


@dataclass(slots=True)
class TrialSweep:
    """A trial's positions ``start`` … ``end``; ``end`` is None while it goes on."""

    start: int
    condition: Condition
    end: int | None = None


def condition_of(status: EngineStatus) -> Condition:
    """Return the condition of the trial that is running, else of the drum's settings."""
    if (current := status.run.current) is not None:
        return Condition(current.texture, current.speed_mm_s, current.force_g)
    return Condition(status.texture or "", status.speed_set_mm_s, status.force_set_g)


class TrialStarts:
    """The newest trials, by the rises and falls of the sync line, as the session cuts them."""

    def __init__(self) -> None:
        self.condition = Condition("", 0.0, 0.0)
        self.clear()

    def clear(self) -> None:
        """Remove all trials."""
        self.trials: list[TrialSweep] = []
        self._row, self._generation, self._is_high = 0, -1, True

    def follow(self, timeline: Timeline) -> None:
        """Find trials in the samples that came since the last call."""
        if timeline.generation != self._generation:
            self.clear()
            self._generation = timeline.generation
        first, self._row = max(self._row, timeline.flags.first), timeline.flags.end
        high = (timeline.flags.between(first, self._row) & Flag.SYNC) > 0
        if not len(high):
            return
        changes = np.flatnonzero(np.diff(high, prepend=self._is_high)) + first
        self._is_high = bool(high[-1])
        for row in changes.tolist():
            self._change(int(timeline.counters.take(np.array([row]))[0]), bool(high[row - first]))

    def newest(self, oldest_position: int) -> TrialSweep | None:
        """Return the newest trial whose beginning is still there."""
        trial = self.trials[-1] if self.trials else None
        return trial if trial is not None and trial.start >= oldest_position else None

    def before(self, trial: TrialSweep, count: int, oldest_position: int) -> list[TrialSweep]:
        """Return at most ``count`` whole trials of its condition before it, the newest last."""
        like = [
            other
            for other in self.trials
            if other.start < trial.start
            and other.condition == trial.condition
            and other.start >= oldest_position
            and other.end is not None
        ]
        return like[-count:] if count else []

    def _change(self, position: int, is_high: bool) -> None:
        if is_high:
            self.trials.append(TrialSweep(position, self.condition))
            del self.trials[:-KEPT]
        elif self.trials:
            self.trials[-1].end = position
