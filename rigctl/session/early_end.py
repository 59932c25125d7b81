"""Planned trials that were not recorded because their conditions ended early, by rule."""

from __future__ import annotations

from collections import defaultdict
from typing import Annotated

import msgspec
from msgspec import Meta

from rigctl.errors import RigctlError
from rigctl.protocol.early_end import QUANTITY_NAMES, Condition, EarlyEnd, condition_of
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.session.format import file_names
from rigctl.session.read.session import Session

EARLY_END_KIND = "early_end"
"""Kind of the event with the condition, and with what its end was judged by."""
Amount = Annotated[float, Meta(ge=0)]


class ConditionEnd(msgspec.Struct, frozen=True):
    """A condition, and the mean of its first ``trials`` trials with half its interval."""

    texture: str
    speed_mm_s: Amount
    force_g: Amount
    depth_mm: Amount
    trials: Annotated[int, Meta(ge=0)]
    mean_hz: Amount
    half_width_hz: Amount

    @property
    def condition(self) -> Condition:
        """Plate, speed, force and depth."""
        return self.texture, self.speed_mm_s, self.force_g, self.depth_mm

    def describe(self, rule: EarlyEnd) -> str:
        """Return why the condition ends."""
        press = f"{self.depth_mm:g} mm" if self.depth_mm else f"{self.force_g:g} g"
        return (
            f"{self.texture}, {self.speed_mm_s:g} mm/s, {press} ends early after {self.trials} "
            f"trials: {QUANTITY_NAMES[rule.of]} {self.mean_hz:.2f} ± {self.half_width_hz:.2f} Hz"
        )


def ended_early(session: Session) -> dict[int, str]:
    """Return the reason for each planned trial that a condition's early end left out, by its id.

    An end holds while the condition still has the trials that it was judged by, and if it keeps the
    rule of the session's protocol.
    """
    events = session.events_of(EARLY_END_KIND)
    plan = plan_of(session) if events else None
    if plan is None or plan.protocol.early_end is None:
        return {}
    rule, committed = plan.protocol.early_end, _committed(session)
    planned: defaultdict[Condition, list[int]] = defaultdict(list)
    for trial in plan.trials:
        planned[condition_of(trial)].append(trial.trial_id)
    reasons: dict[int, str] = {}
    for event in events:
        try:
            end = msgspec.convert(event.data, ConditionEnd)
        except msgspec.ValidationError:  # no engine wrote it
            continue
        if end.half_width_hz > rule.half_width_hz:
            continue
        ids = planned[end.condition]
        counted = len(committed.intersection(ids))
        if counted >= max(end.trials, rule.least_trials):
            reasons |= dict.fromkeys(sorted(set(ids) - committed), event.text)
    return reasons


def describe_ends(reasons: dict[int, str]) -> list[str]:
    """Return a sentence for each condition that ended early."""
    by_reason: defaultdict[str, list[int]] = defaultdict(list)
    for trial_id, reason in reasons.items():
        by_reason[reason].append(trial_id)
    return [
        f"{reason}; {len(ids)} trial{'' if len(ids) == 1 else 's'} not recorded"
        for reason, ids in by_reason.items()
    ]


def plan_of(session: Session) -> Plan | None:
    """Return the plan from a session's protocol and seed, None if that cannot be read."""
    try:
        protocol = parse_protocol(session.protocol_text, file_names.PROTOCOL_FILE, session.config)
        return protocol.plan(session.header.seed)
    except RigctlError:
        return None


def _committed(session: Session) -> set[int]:
    return set(session.trials["trial_id"][session.committed()].tolist())
