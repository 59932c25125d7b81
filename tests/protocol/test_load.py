"""A protocol is planned as written, and mistakes are refused with file, line and key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.config.resources import protocols
from rigctl.config.rig_config import RigConfig
from rigctl.errors import ProtocolError
from rigctl.protocol.loader import load_protocol, parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.protocol.steps import ApproachOnly, Baseline, ChangePlate, Message, Rest, RunTrial, Tare

GOOD = """\
textures = ["A", "B"]
speeds_mm_s = [40, 120]
forces_g = [250]
repeats = 2
"""


def plan_of(text: str, seed: int | None = None) -> Plan:
    return parse_protocol(text, "some.toml").plan(seed)


def test_blocked_order_is_texture_force_speed_repeat() -> None:
    plan = plan_of(GOOD.replace("[250]", "[250, 500]"))
    first = [(t.texture, t.force_g, t.speed_mm_s, t.repeat) for t in plan.trials[:5]]
    assert first == [
        ("A", 250, 40, 1),
        ("A", 250, 40, 2),
        ("A", 250, 120, 1),
        ("A", 250, 120, 2),
        ("A", 500, 40, 1),
    ]
    assert [t.trial_id for t in plan.trials] == list(range(1, 17))
    assert plan.plate_changes == 2


def test_the_paper_protocol_has_the_design_of_the_papers_data_set() -> None:
    plan = load_protocol(protocols() / "paper.toml").plan()
    assert len(plan.trials) == 24_000
    assert plan.plate_changes == 16
    assert {t.speed_mm_s: t.duration_s for t in plan.trials} == {
        40: 6,
        60: 4,
        80: 3,
        100: 2.4,
        120: 2,
    }
    assert {t.force_g for t in plan.trials} == {250, 500, 1000}
    conditions = {(t.texture, t.speed_mm_s, t.force_g, t.repeat) for t in plan.trials}
    assert len(conditions) == 24_000


def test_quick_takes_a_few_minutes_and_allows_a_stratified_split() -> None:
    plan = load_protocol(protocols() / "quick.toml").plan()
    assert 150 < plan.duration_s < 300
    for texture in plan.protocol.textures:
        assert sum(t.texture == texture for t in plan.trials) >= 4


def test_baseline_never_touches_the_drum() -> None:
    plan = load_protocol(protocols() / "baseline.toml").plan()
    assert plan.trials == ()
    assert {type(step) for step in plan.steps} == {Tare, Baseline}


def test_showcase_holds_every_kind_of_step() -> None:
    plan = load_protocol(protocols() / "showcase.toml").plan()
    kinds = {type(step) for step in plan.steps}
    assert kinds == {ChangePlate, RunTrial, Tare, Rest, ApproachOnly, Baseline, Message}
    prompts = [step.prompt for step in plan.steps if isinstance(step, ChangePlate)]
    assert prompts[1] == "Snap in plate D with its arrow forwards, then confirm."
    assert {t.direction for t in plan.trials} == {"forward", "backward"}


def test_free_steps_keep_their_order() -> None:
    steps = "".join(
        f'[[steps]]\nat = "{place}"\nkind = "message"\ntext = "{place}"\n'
        for place in ("start", "plate_start", "between_plates", "plate_end", "end")
    )
    every = '[[steps]]\nat = "every"\ntrials = 3\nkind = "tare"\n'
    words = [
        step.text if isinstance(step, Message) else type(step).__name__
        for step in plan_of(GOOD + steps + every).steps
    ]
    trials = ["RunTrial"] * 4
    assert words == [
        "start",
        "ChangePlate",
        "plate_start",
        *["RunTrial", "RunTrial", "RunTrial", "Tare", "RunTrial"],
        "plate_end",
        "between_plates",
        "ChangePlate",
        "plate_start",
        *["RunTrial", "RunTrial", "Tare", *trials[:2]],
        "plate_end",
        "end",
    ]


def test_position_mode_presses_to_depths() -> None:
    text = GOOD.replace("forces_g = [250]", "depths_mm = [0.5, 1.0]")
    plan = plan_of(text + '[trial]\nforce_mode = "position"\n')
    assert {(t.depth_mm, t.force_g) for t in plan.trials} == {(0.5, 0), (1.0, 0)}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD + "repeat = 3\n", ["line 5", "repeat", "unknown key", "did you mean 'repeats'"]),
        (
            GOOD.replace("speeds_mm_s", "speeds_mms"),
            ["line 2", "did you mean 'speeds_mm_s'"],
        ),
        (GOOD.replace("120", "1200"), ["line 2", "speeds_mm_s", "1200 is outside 20 to 150 mm/s"]),
        (GOOD.replace("120", "nan"), ["line 2", "nan is outside"]),
        (GOOD.replace("120", "'fast'"), ["line 2", "must be a number, not 'fast'"]),
        (GOOD.replace("120", "true"), ["line 2", "must be a number, not true"]),
        (GOOD.replace("120", "40"), ["line 2", "contains 40.0 twice"]),
        (GOOD.replace("[250]", "[5000]"), ["line 3", "forces_g", "outside 50 to 1200 g"]),
        (GOOD.replace("[250]", "250"), ["line 3", "must be a list of numbers"]),
        (GOOD.replace("= 2", "= 0"), ["line 4", "repeats", "0 is outside 1"]),
        (GOOD.replace("= 2", "= 2.5"), ["line 4", "whole number"]),
        (GOOD.replace("= 2", "= 90000"), ["line 4", "trials"]),
        (GOOD.replace('["A", "B"]', "[1]"), ["line 1", "must contain texts in quotes"]),
        (GOOD.replace('["A", "B"]', "[]"), ["line 1", "list of texts"]),
        (GOOD.replace('["A", "B"]', '["A", "A"]'), ["line 1", "contains 'A' twice"]),
        (GOOD.replace('"A"', f'"{"x" * 17}"'), ["line 1", "longer than 16 bytes"]),
        (GOOD + "[trial]\ntravel_mm = 360\n", ["line 6", "travel_mm", "do not fit on the plate"]),
        (GOOD + "[trial]\nforce_mode = 'holt'\n", ["line 6", "did you mean 'hold'"]),
        (GOOD + "[trial]\nforce_mode = 'position'\n", ["line 3", "give depths_mm instead"]),
        (GOOD + "[order]\nkind = 'shuffled'\n", ["order.seed", "needs a written seed"]),
        (GOOD + "[order]\nacross_plates = true\n", ["line 6", "shuffled"]),
        (GOOD + "[settel]\n", ["line 5", "did you mean 'settle'"]),
        (GOOD + "[settle]\ntime_s = 20\n", ["line 6", "outside 0.05 to 5 s"]),
        (GOOD + "[settle]\ntime_s = 3\ntimeout_s = 2\n", ["line 7", "longer than time_s"]),
        (GOOD + "[[steps]]\nat = 'start'\nkind = 'rest'\n", ["steps[1].seconds", "missing"]),
        (
            GOOD + "[[steps]]\nat='end'\nkind='tare'\n[[steps]]\nat='end'\nkind='tear'\n",
            ["line 10", "steps[2].kind", "did you mean 'tare'"],
        ),
        (
            GOOD + "[[steps]]\nat='end'\nkind='tare'\nseconds=1\n",
            ["line 8", "steps[1].seconds", "unknown key"],
        ),
        ("textures = ['A'\n", ["not TOML"]),
        (GOOD + "name = oops\n", ["not TOML", "line 5"]),
        ("textures = ['A']\n", ["missing: trials need"]),
        ("name = 'empty'\n", ["nothing to do"]),
        ("order = 3\n", ["line 1", "must be a table, written [order]"]),
        (GOOD + "steps = 1\n", ["line 5", "[[steps]]"]),
    ],
)
def test_a_mistake_names_file_line_and_key(text: str, words: list[str]) -> None:
    with pytest.raises(ProtocolError) as caught:
        plan_of(text)
    message = str(caught.value)
    assert message.startswith("some.toml")
    for word in words:
        assert word in message


ODD_VALUES = (
    "true",
    '""',
    "[]",
    "[[]]",
    "{}",
    "[1, 'a']",
    "-1",
    "0",
    "1e308",
    "nan",
    "inf",
    "9" * 400,
    "9" * 5000,
    "1979-05-27",
    "'A'",
    "[{}]",
    "[1" + "0" * 400 + "]",
)


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_a_corrupted_protocol_raises_only_a_protocol_error(data: st.DataObject) -> None:
    lines = (protocols() / "showcase.toml").read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(lines) - 1))
        key, equals, _ = lines[place].partition("=")
        odd = data.draw(st.sampled_from(ODD_VALUES))
        spoilt = (f"{key}{equals}{odd}", "", lines[place] * 2, lines[place][1:], odd)
        lines[place] = data.draw(st.sampled_from(spoilt))
    try:
        plan = plan_of("\n".join(lines))
    except ProtocolError as error:
        assert str(error).startswith("some.toml")
    else:
        assert plan.duration_s > 0
        assert len(plan.hash) == 32


def test_a_speed_whose_ramp_is_longer_than_the_run_in_is_refused() -> None:
    rig = RigConfig()
    slow = replace(rig, drum=replace(rig.drum, acceleration_mm_s2=60))
    with pytest.raises(ProtocolError, match=r"line 2: speeds_mm_s: the ramp to 120 mm/s"):
        parse_protocol(GOOD, "some.toml", slow)


def test_a_missing_or_unreadable_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProtocolError, match=r"cannot read .*none\.toml: No such file"):
        load_protocol(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProtocolError, match="not UTF-8 text"):
        load_protocol(binary)
    with pytest.raises(ProtocolError, match="cannot read"):
        load_protocol(tmp_path)
