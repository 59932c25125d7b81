"""Ends conditions of a run before their repeats, where its protocol allows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from msgspec.structs import asdict

from rigctl.acquisition.early_end.condition_end import ConditionEnd
from rigctl.acquisition.protocol.progress import RunProgress
from rigctl.acquisition.protocol.run_steps import RunSteps
from rigctl.errors import WrongUse
from rigctl.protocol.early_end import EarlyEnd, condition_of
from rigctl.protocol.plan import Plan
from rigctl.session.session import EARLY_END_KIND
from rigctl.values import PlannedTrial


class EarlyEnds:
    """Takes trials of conditions that are known well enough out of the steps that are to come.

    ``committed_attempt`` returns the attempt at a trial that counts, 0 for none. ``publish`` makes
    the event of the session. ``left_out``: the trials that earlier sittings left out, by their id.
    """

    def __init__(
        self,
        plan: Plan,
        steps: RunSteps,
        committed_attempt: Callable[[int], int],
        progress: RunProgress,
        publish: Callable[..., Any],
        left_out: Iterable[int] = (),
    ) -> None:
        self._plan = plan
        self._steps = steps
        self._committed_attempt = committed_attempt
        self._progress = progress
        self._publish = publish
        self._left_out = set(left_out)

    def end(self, end: ConditionEnd) -> None:
        """Leave out the trials of a condition that are to come; none are left is no error.

        Raises WrongUse where the protocol's rule does not allow it.
        """
        rule = self._checked_rule(end)
        left_out = [t for t in self._steps.trials() if condition_of(t) == end.condition]
        if not left_out:
            return
        self._steps.drop(left_out)
        self._progress.end_early(left_out)
        self._left_out.update(trial.trial_id for trial in left_out)
        self._publish(EARLY_END_KIND, end.describe(rule), **asdict(end))

    def require_kept(self, trial_id: int) -> None:
        """Raise WrongUse for a trial that is left out: no attempt at it could count."""
        if trial_id in self._left_out:
            raise WrongUse(f"trial {trial_id} is left out: its condition ended early")

    def _checked_rule(self, end: ConditionEnd) -> EarlyEnd:
        rule = self._plan.protocol.early_end
        if rule is None:
            raise WrongUse("this protocol has no [early_end]: every trial of it is recorded")
        if end.trials < rule.least_trials or end.half_width_hz > rule.half_width_hz:
            raise WrongUse(
                f"the condition may end from {rule.least_trials} trials and "
                f"± {rule.half_width_hz:g} Hz on: {end.trials} trials and "
                f"± {end.half_width_hz:g} Hz are not enough"
            )
        counted = sum(map(self._counts, self._trials_of(end)))
        if counted < end.trials:
            raise WrongUse(f"{counted} trials of the condition count, not {end.trials}")
        return rule

    def _trials_of(self, end: ConditionEnd) -> list[PlannedTrial]:
        return [trial for trial in self._plan.trials if condition_of(trial) == end.condition]

    def _counts(self, trial: PlannedTrial) -> bool:
        return self._committed_attempt(trial.trial_id) > 0
