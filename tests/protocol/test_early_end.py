"""``[early_end]`` in a protocol: what it may say, and what is refused at its line."""

from __future__ import annotations

import pytest

from rigctl.engine.run_steps import RunSteps
from rigctl.errors import ProtocolError
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.steps import ChangePlate, RunTrial

TRIALS = """\
textures = ["A", "B"]
speeds_mm_s = [40, 120]
forces_g = [250]
repeats = 10
"""
STEPS = '[[steps]]\nat = "start"\nkind = "tare"\n'
RULE = TRIALS + '[early_end]\nof = "ra_rate"\nhalf_width_hz = 1.5\n'


def test_a_rule_is_read_and_changes_the_plan() -> None:
    ruled, free = (parse_protocol(text, "some.toml").plan() for text in (RULE, TRIALS))
    rule = ruled.protocol.early_end
    assert rule is not None and free.protocol.early_end is None
    assert (rule.of, rule.half_width_hz, rule.confidence_percent, rule.least_trials) == (
        *("ra_rate", 1.5, 95.0),
        5,
    )
    assert ruled.hash != free.hash and (ruled.fewest_trials, free.fewest_trials) == (20, 40)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TRIALS + "[early_end]\n", "half_width_hz"),
        (RULE + "half_with = 1\n", "half_with"),
        (RULE + "least_trials = 4\n", "line 8"),
        (RULE + "least_trials = 10\n", "no condition could end early"),
        (RULE + "confidence_percent = 100\n", "confidence_percent"),
        (RULE.replace("ra_rate", "rate"), "line 6"),
        (RULE.replace("1.5", "0"), "line 7"),
        ("mounts = 2\n" + RULE, "one mounting"),
        ("[early_end]\nhalf_width_hz = 1\n" + STEPS, "needs trials"),
    ],
)
def test_a_rule_that_cannot_be_meant_is_refused(text: str, words: str) -> None:
    with pytest.raises(ProtocolError, match=words):
        parse_protocol(text, "some.toml")


def test_a_plate_without_trials_to_come_is_not_asked_for() -> None:
    text = TRIALS.replace('"B"]', '"B", "C"]')
    plan = parse_protocol(text, "some.toml").plan()
    steps = RunSteps(plan.steps)
    steps.drop([trial for trial in plan.trials if trial.texture != "B"])
    left = list(steps)
    assert [step.texture for step in left if isinstance(step, ChangePlate)] == ["B"]
    assert sum(isinstance(step, RunTrial) for step in left) == 20
