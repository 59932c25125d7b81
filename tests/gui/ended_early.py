"""A recorded session whose conditions ended early by the rule of its protocol."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import asdict

from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import EarlyEnd
from rigctl.session.recorder import Recorder
from rigctl.session.session import EARLY_END_KIND, ConditionEnd
from rigctl.values import Event
from tests.session.building import RIG, SyntheticRig, header

SPEEDS_MM_S = (60, 80, 100, 120)
PLANNED, RECORDED = 7, 5
"""Trials of each condition."""
PROTOCOL = f"""
name = "early"
textures = ["A"]
speeds_mm_s = {list(SPEEDS_MM_S)}
forces_g = [250]
repeats = {PLANNED}
[trial]
travel_mm = 12
[early_end]
half_width_hz = 2
least_trials = {RECORDED}
"""


def record_early_ends(folder: Path, conditions: int = len(SPEEDS_MM_S)) -> list[str]:
    """Record five of the seven trials of each condition; return why the first ones ended."""
    plan = parse_protocol(PROTOCOL, "early.toml").plan()
    reasons = []
    with Recorder(folder, header(plan), PROTOCOL, RIG) as rec:
        source = SyntheticRig(rec)
        rec.begin_part("plate change", "A")
        for number, speed_mm_s in enumerate(SPEEDS_MM_S):
            trials = [trial for trial in plan.trials if trial.speed_mm_s == speed_mm_s]
            for trial in trials[:RECORDED]:
                source.trial(trial)
            if number < conditions:
                end = ConditionEnd("A", speed_mm_s, 250.0, 0.0, RECORDED, 41.25, 1.5)
                reasons.append(end.describe(EarlyEnd()))
                at_s = source.counter / 1000
                rec.add_event(Event(at_s, EARLY_END_KIND, reasons[-1], asdict(end)))
    return reasons
