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
        """Leave out trials that are to come, and plates that none of them need any longer."""
        dropped = set(trials)
        self._steps = deque(
            step
            for step in self._steps
            if not (isinstance(step, RunTrial) and step.trial in dropped)
        )
        self._steps = deque(_with_trials(self._steps))

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


def _with_trials(steps: Iterable[Step]) -> Iterator[Step]:
    """Yield steps without the changes to plates that have no trial.

    The steps of such a plate go too, but those after the last change, as the end of the plan is
    among them.
    """
    blocks: list[list[Step]] = [[]]
    for step in steps:
        if isinstance(step, ChangePlate):
            blocks.append([])
        blocks[-1].append(step)
    yield from blocks[0]
    for number, block in enumerate(blocks[1:], start=2):
        if any(isinstance(step, RunTrial) for step in block):
            yield from block
        elif number == len(blocks):
            yield from block[1:]
