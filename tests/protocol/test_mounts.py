"""``mounts`` in a protocol asks for each plate again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.engine.step_runner import mountings_before, remaining_steps
from rigctl.errors import ProtocolError
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.protocol.steps import ChangePlate, RunTrial

TWICE = """\
textures = ["A", "B"]
speeds_mm_s = [40, 120]
forces_g = [250]
repeats = 2
mounts = 2
"""
ONCE = TWICE.replace("mounts = 2\n", "")


def plan_of(text: str, seed: int | None = None) -> Plan:
    return parse_protocol(text, "some.toml").plan(seed)


def prompts(plan: Plan) -> list[str]:
    return [step.prompt for step in plan.steps if isinstance(step, ChangePlate)]


def test_all_plates_come_before_one_comes_again() -> None:
    plan = plan_of(TWICE)
    assert [(t.texture, t.mount, t.repeat) for t in plan.trials[::2]] == [
        (texture, mount, 1) for mount in (1, 2) for texture in "AB" for _ in range(2)
    ]
    assert [t.trial_id for t in plan.trials] == list(range(1, 17))
    assert prompts(plan) == [
        "Mount plate A, then confirm. (mounting 1 of 2)",
        "Mount plate B, then confirm. (mounting 1 of 2)",
        "Mount plate A, then confirm. (mounting 2 of 2; take the plate off first if it is on)",
        "Mount plate B, then confirm. (mounting 2 of 2; take the plate off first if it is on)",
    ]


def test_a_single_plate_is_asked_for_again() -> None:
    assert len(prompts(plan_of(TWICE.replace('"A", "B"', '"A"')))) == 2


def test_each_mounting_is_shuffled_by_itself() -> None:
    plan = plan_of(
        TWICE.replace("repeats = 2", "repeats = 4") + "[order]\nkind = 'shuffled'\nseed = 1\n"
    )
    assert plan.plate_changes == 4
    speeds = [[t.speed_mm_s for t in plan.trials[i : i + 8]] for i in range(0, 32, 8)]
    assert len({tuple(order) for order in speeds}) > 1
    assert all(sorted(order) == sorted(speeds[0]) for order in speeds)


def test_a_plate_that_is_mounted_in_between_counts_its_mountings() -> None:
    plan = plan_of(ONCE + "[order]\nkind = 'shuffled'\nseed = 1\nacross_plates = true\n")
    changes = [step.texture for step in plan.steps if isinstance(step, ChangePlate)]
    for texture in "AB":
        mounts = [t.mount for t in plan.trials if t.texture == texture]
        assert set(mounts) == set(range(1, changes.count(texture) + 1))
        assert mounts == sorted(mounts)


def test_plates_mounted_once_keep_the_plan_that_sessions_were_recorded_with() -> None:
    assert plan_of(ONCE).hash == plan_of(ONCE + "mounts = 1\n").hash
    assert plan_of(ONCE).hash == "532f5cd975379192e2b85c38ab631852"
    assert plan_of(ONCE).hash != plan_of(TWICE).hash
    assert {t.mount for t in plan_of(ONCE).trials} == {1}


def test_what_is_left_of_a_mounting_asks_for_the_plate_of_that_mounting() -> None:
    plan = plan_of(TWICE)
    left = list(remaining_steps(plan.steps, frozenset(range(1, 11))))
    first = left[0]
    assert mountings_before(plan.steps, frozenset(range(1, 11))) == 2
    assert mountings_before(plan.steps, frozenset()) == 0
    assert isinstance(first, ChangePlate) and "A, then confirm. (mounting 2 of 2" in first.prompt
    assert [s.trial.trial_id for s in left if isinstance(s, RunTrial)] == list(range(11, 17))


def test_check_counts_each_mounting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path := tmp_path / "twice.toml").write_text(TWICE)
    assert main(["check", str(path)]) == 0
    text = capsys.readouterr().out
    assert "plate changes       4, each plate mounted 2 times" in text
    assert "trials              16 of 240 mm" in text
    assert main(["check", str(path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["mounts"], answer["people_seconds"]) == (2, 240.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TWICE.replace("mounts = 2", "mounts = 0"), "line 5: mounts: 0 is outside 1 to 100"),
        (TWICE.replace("mounts = 2", "mounts = 1.5"), "line 5: mounts: must be a whole number"),
        (TWICE.replace("repeats = 2", "repeats = 20000"), "line 5: mounts: make 160,000 trials"),
        ("mounts = 2\n[[steps]]\nat = 'start'\nkind = 'tare'\n", "is missing: trials need"),
        (
            TWICE + "[order]\nkind = 'shuffled'\nseed = 1\nacross_plates = true\n",
            "line 9: order.across_plates: mounts a plate before nearly every trial",
        ),
    ],
)
def test_a_mistake_names_its_line(text: str, words: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        plan_of(text)
    assert words in str(caught.value)
