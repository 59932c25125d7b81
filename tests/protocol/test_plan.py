"""Properties of every plan."""

from __future__ import annotations

from collections import Counter

from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.config.rig_config import RigConfig
from rigctl.protocol.plan import Protocol
from rigctl.protocol.steps import ChangePlate, RunTrial

TEXTURES = st.lists(st.sampled_from("ABCDEFGH"), min_size=1, max_size=5, unique=True)
SPEEDS = st.lists(st.sampled_from([40.0, 60.0, 80.0, 120.0]), min_size=1, max_size=3, unique=True)
FORCES = st.lists(st.sampled_from([250.0, 500.0, 1000.0]), min_size=1, max_size=3, unique=True)


@st.composite
def protocol(draw: st.DrawFn) -> Protocol:
    return Protocol(
        name="drawn",
        text="",
        config=RigConfig(),
        textures=tuple(draw(TEXTURES)),
        speeds_mm_s=tuple(draw(SPEEDS)),
        forces_g=tuple(draw(FORCES)),
        repeats=draw(st.integers(1, 4)),
        order=draw(st.sampled_from(["blocked", "shuffled"])),
        order_seed=draw(st.integers(0, 2**32)),
        across_plates=draw(st.booleans()),
    )


@given(protocol())
@settings(max_examples=60, deadline=None)
def test_each_condition_occurs_once_and_ids_are_consecutive(drawn: Protocol) -> None:
    plan = drawn.plan()
    wanted = len(drawn.textures) * len(drawn.speeds_mm_s) * len(drawn.forces_g) * drawn.repeats
    conditions = Counter((t.texture, t.speed_mm_s, t.force_g, t.repeat) for t in plan.trials)
    assert len(conditions) == wanted
    assert set(conditions.values()) == {1}
    assert [t.trial_id for t in plan.trials] == list(range(1, wanted + 1))


@given(protocol())
@settings(max_examples=60, deadline=None)
def test_plates_are_changed_only_when_needed(drawn: Protocol) -> None:
    mounted = None
    for step in drawn.plan().steps:
        if isinstance(step, ChangePlate):
            assert step.texture != mounted
            mounted = step.texture
        if isinstance(step, RunTrial):
            assert step.trial.texture == mounted


@given(protocol())
@settings(max_examples=60, deadline=None)
def test_shuffling_adds_plate_changes_only_if_requested(drawn: Protocol) -> None:
    if not (drawn.order == "shuffled" and drawn.across_plates):
        assert drawn.plan().plate_changes == len(drawn.textures)


@given(protocol(), st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_a_seed_determines_the_plan(drawn: Protocol, seed: int) -> None:
    first, again = drawn.plan(seed), drawn.plan(seed)
    assert first.steps == again.steps
    assert first.hash == again.hash
    if drawn.plan(seed + 1).steps != first.steps:
        assert drawn.plan(seed + 1).hash != first.hash


def test_the_order_of_a_seed_never_changes() -> None:
    """A session's plan hash depends on the shuffle, so the shuffle must never change."""
    plan = Protocol(
        "fixed",
        "",
        RigConfig(),
        textures=("A",),
        speeds_mm_s=(40.0, 60.0, 80.0, 100.0, 120.0),
        forces_g=(250.0,),
        repeats=1,
        order="shuffled",
        order_seed=1,
    ).plan()
    assert [t.speed_mm_s for t in plan.trials] == [40, 100, 120, 80, 60]
