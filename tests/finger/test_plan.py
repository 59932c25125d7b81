"""Protocols of the moving finger: the paper's counts, reproducible orders, refused mistakes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from rigctl.config.resources import find_finger_protocol, finger_protocols
from rigctl.errors import ProtocolError
from rigctl.finger.plan import (
    ScanQuality,
    StageRepeats,
    load_finger_protocol,
    parse_finger_protocol,
)
from rigctl.finger.values import Stage, VelocityProfile
from rigctl.protocol.loader import load_protocol
from tests.config.reference import rows

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "protocols.md"

SMALL = 'textures = ["A", "B"]\n'


def test_the_papers_protocol_has_the_papers_counts() -> None:
    plan = load_finger_protocol(find_finger_protocol("paper")).plan(Stage)
    counts = Counter((trial.stage, trial.texture) for trial in plan.trials)
    per_texture = {Stage.NORMALISE: 10, Stage.TRAIN: 20, Stage.CALIBRATE: 10, Stage.RUN: 20}
    assert counts == {(s, t): n for s, n in per_texture.items() for t in "ABDLN"}
    profiles = Counter(t.profile for t in plan.trials if t.stage is Stage.TRAIN)
    assert profiles == dict.fromkeys(VelocityProfile, 20)
    assert [trial.trial_id for trial in plan.trials] == list(range(1, 301))


def test_stages_come_in_their_order_and_each_is_shuffled_by_the_seed() -> None:
    protocol = load_finger_protocol(finger_protocols() / "paper.toml")
    plan = protocol.plan([Stage.TRAIN, Stage.NORMALISE])
    assert [trial.stage for trial in plan.trials] == [Stage.NORMALISE] * 50 + [Stage.TRAIN] * 100
    assert plan.hash == protocol.plan([Stage.NORMALISE, Stage.TRAIN]).hash
    assert plan.hash != protocol.plan([Stage.NORMALISE, Stage.TRAIN], seed=2).hash
    run = protocol.plan([Stage.RUN]).trials
    textures = [trial.texture for trial in run]
    assert textures != sorted(textures)


def test_a_blocked_order_keeps_the_plates_together() -> None:
    plan = parse_finger_protocol(SMALL, "small.toml").plan([Stage.CALIBRATE])
    assert [trial.texture for trial in plan.trials] == ["A"] * 10 + ["B"] * 10


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "textures: is missing"),
        ('textures = ["A"]', "needs at least two plates"),
        (SMALL + 'profiles = ["hasty"]', "line 2: profiles: 'hasty' is none of slow, medium"),
        (SMALL + "[stages]\ntrain = -1", "line 3: stages.train: -1 is outside 0 to 1000"),
        (SMALL + "[stages]\nnormalise=0\ntrain=0\ncalibrate=0\nrun=0", "make 0 scans"),
        (SMALL + '[order]\nkind = "shuffled"', "order.seed: is missing"),
        (SMALL + "[quality]\nslow_max_mm_s = 200", "fast_min_mm_s: must be above slow_max_mm_s"),
        (SMALL + "speeds_mm_s = [1]", "line 2: speeds_mm_s: unknown key"),
    ],
)
def test_a_mistake_names_its_line_and_key(text: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        parse_finger_protocol(text, "small.toml")


def test_an_unknown_name_lists_the_built_in_protocols() -> None:
    with pytest.raises(ProtocolError, match="a built-in name: paper, quick"):
        find_finger_protocol("nothing")


def test_a_protocol_of_the_finger_is_not_one_of_the_drum() -> None:
    with pytest.raises(ProtocolError, match=r"line 6: profiles: .* record it with `rigctl realti"):
        load_protocol(finger_protocols() / "quick.toml")


@pytest.mark.parametrize("section", [StageRepeats, ScanQuality])
def test_the_reference_page_has_each_key(section: type[StageRepeats | ScanQuality]) -> None:
    assert rows(section) in PAGE.read_text(encoding="utf-8")
