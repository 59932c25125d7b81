"""What `[trial] lift = "condition"` and a tare by drift plan, and where they are refused."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from rigctl.bench.world_file import SimulatedWorld
from rigctl.cli import check
from rigctl.config.resources import find_protocol
from rigctl.config.rig_config import RigConfig
from rigctl.errors import ProtocolError
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.protocol.steps import RunTrial, Tare

LEVEL = SimulatedWorld().rig_config()
NAMED = 'textures = ["A", "B"]\nspeeds_mm_s = [40, 120]\nforces_g = [250]\nrepeats = 4\n'
BY_CONDITION = '[trial]\nlift = "condition"\n'
ALTERNATE = 'direction = "alternate"\n'
DRIFT = '[[steps]]\nat = "drift"\nkind = "tare"\nlimit_g = 2\n'


def plan_of(text: str, config: RigConfig = LEVEL) -> Plan:
    return parse_protocol(text, "some.toml", config).plan()


def ways_mm(plan: Plan) -> list[float | None]:
    """Return the way in contact to each trial's window after the step before it."""
    pairs = zip(plan.steps, plan.steps[1:], strict=False)
    return [plan.protocol.way_between_mm(a, b) for a, b in pairs if isinstance(b, RunTrial)]


@pytest.mark.parametrize("text", [NAMED, NAMED + '[trial]\nlift = "trial"\n'])
def test_a_drum_lifts_after_each_trial_by_default(text: str) -> None:
    assert set(ways_mm(plan_of(text))) == {None}
    assert plan_of(text).hash == plan_of(NAMED).hash


def test_repeats_turn_on_to_the_same_window() -> None:
    ways = ways_mm(plan_of(NAMED + BY_CONDITION))
    slow, fast = 155 - 40**2 / 1200, 155 - 120**2 / 1200
    assert ways == [None, *[pytest.approx(slow)] * 3, None, *[pytest.approx(fast)] * 3] * 2


def test_alternating_repeats_turn_back_before_the_joint() -> None:
    plan = plan_of(NAMED + BY_CONDITION + ALTERNATE, RigConfig())
    assert ways_mm(plan)[1] == pytest.approx(75 + 40**2 / 1200)
    first, third = (step for step in plan.steps if isinstance(step, RunTrial)
                    if step.trial.trial_id in (1, 3))  # fmt: skip
    assert plan.protocol.way_between_mm(first, third) is None, "trial 2 was left out"


@pytest.mark.parametrize("more", ["[trial]\nlift = 'condition'\n", DRIFT])
def test_the_plan_says_when_it_lifts_and_tares(more: str) -> None:
    plan, lifted = plan_of(NAMED + more), plan_of(NAMED)
    assert plan.steps == lifted.steps
    assert plan.hash != lifted.hash


def test_a_tare_by_drift_is_no_step_of_the_plan() -> None:
    plan = plan_of(NAMED + DRIFT)
    assert not any(isinstance(step, Tare) for step in plan.steps)
    assert plan.protocol.drift_limit_g == 2


def test_the_paper_takes_forty_hours_by_condition() -> None:
    text = find_protocol("paper").read_text()
    lifted = plan_of(text)
    staying = plan_of(text.replace("[trial]\n", BY_CONDITION))
    assert lifted.protocol.lift == "trial"
    assert lifted.duration_s / 3600 == pytest.approx(52.3, abs=0.1)
    assert staying.duration_s / 3600 < 40
    assert staying.bytes_estimate < lifted.bytes_estimate


def test_check_shows_when_the_drum_lifts() -> None:
    summary = check.describe(plan_of(NAMED + BY_CONDITION))
    assert summary["lift"] == "condition"
    assert "lifts               after each condition" in check.table(summary)
    assert "lifts " not in check.table(check.describe(plan_of(NAMED)))
    assert json.loads(json.dumps(summary)) == summary


@pytest.mark.parametrize(
    ("text", "config", "words"),
    [
        (BY_CONDITION, RigConfig(), ["drum.level_joint in rig.toml", '"alternate"']),
        (BY_CONDITION + 'force_mode = "lock"\n', LEVEL, ['needs force_mode = "hold"']),
        (
            BY_CONDITION + '[order]\nkind = "shuffled"\nseed = 1\n',
            LEVEL,
            ['needs order.kind = "blocked"'],
        ),
        (BY_CONDITION + "travel_mm = 100\n", LEVEL, ["leaves 294 mm", "5 to 200 mm"]),
        (
            BY_CONDITION + ALTERNATE + "travel_mm = 120\n",
            RigConfig(),
            ["leaves -44 mm from a trial at 40 mm/s"],
        ),
        (DRIFT.replace('"tare"', '"rest"\nseconds = 3'), LEVEL, ['at = "drift" goes with kind']),
        (DRIFT.replace("= 2", "= 20"), LEVEL, ["limit_g", "outside 0.5 to 10 g"]),
        (DRIFT.replace("limit_g = 2\n", ""), LEVEL, ["limit_g", "missing"]),
        (DRIFT.replace('"drift"', '"start"'), LEVEL, ["limit_g", "unknown key"]),
    ],
)
def test_a_mistake_names_the_cure(text: str, config: RigConfig, words: list[str]) -> None:
    with pytest.raises(ProtocolError) as error:
        plan_of(NAMED + text, config)
    assert all(word in str(error.value) for word in words), error.value


def test_a_level_joint_is_asked_of_the_rig() -> None:
    drum = replace(RigConfig().drum, level_joint=True)
    assert plan_of(NAMED + BY_CONDITION, replace(RigConfig(), drum=drum)).trials
