"""The steps of a sitting that are still to come; trials can be put among them again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import takewhile

from rigctl.errors import WrongUse
from rigctl.protocol.steps import ChangePlate, RunTrial, Step
from rigctl.values import PlannedTrial


class RunSteps:
    """Yields each step once, in order, those added meanwhile included."""

    def __init__(self, steps: Iterable[Step]) -> None:
        self._steps = deque(steps)
        self._taken: PlannedTrial | None = None

    def __iter__(self) -> Iterator[Step]:
        while self._steps:
            step = self._steps.popleft()
            if isinstance(step, RunTrial):
                self._taken = step.trial
            elif isinstance(step, ChangePlate):
                self._taken = None
            yield step

    def repeat(self, trial: PlannedTrial) -> None:
        """Run a trial again after the others of the plate that is on.

        Raises WrongUse for a trial of another plate or mounting, and for one that is to come.
        """
        if any(isinstance(step, RunTrial) and step.trial == trial for step in self._steps):
            raise WrongUse(f"trial {trial.trial_id} is still to come: there is nothing to repeat")
        mounted = self._taken or next(iter(self.trials_on_plate()), None)
        if mounted is None or (mounted.texture, mounted.mount) != (trial.texture, trial.mount):
            raise WrongUse(
                f"trial {trial.trial_id} is of plate {trial.texture}, which is not on now: mark it "
                "bad, and continue the session after its end, which records it again"
            )
        self._steps.insert(self._end_of_trials(), RunTrial(trial))

    def drop(self, trials: Iterable[PlannedTrial]) -> None:
        """Leave out trials that are to come."""
        dropped = set(trials)
        self._steps = deque(
            step
            for step in self._steps
            if not (isinstance(step, RunTrial) and step.trial in dropped)
        )

    def trials(self) -> list[PlannedTrial]:
        """Return the trials that are to come."""
        return [step.trial for step in self._steps if isinstance(step, RunTrial)]

    def trials_on_plate(self) -> list[PlannedTrial]:
        """Return the trials that are to come before the next change of plates."""
        return [step.trial for step in self._on_plate() if isinstance(step, RunTrial)]

    @property
    def next_plate(self) -> str | None:
        """The plate of the next change, None if there is none."""
        changes = (step.texture for step in self._steps if isinstance(step, ChangePlate))
        return next(changes, None)

    def _on_plate(self) -> Iterator[Step]:
        return takewhile(lambda step: not isinstance(step, ChangePlate), self._steps)

    def _end_of_trials(self) -> int:
        """Return the place behind the last trial before the next change of plates."""
        places = (i for i, step in enumerate(self._on_plate(), 1) if isinstance(step, RunTrial))
        return max(places, default=0)
