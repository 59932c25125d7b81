"""Damaged bytes on the cables: a little noise costs nothing, much of it pauses the run."""

from __future__ import annotations

import pytest

from rigctl.analysis.trial_set import join_sessions
from rigctl.session.verify import verify
from tests.engine.engine_harness import EngineHarness, open_session, until_ended

MANY = """
name = "many"
textures = ["A", "L"]
speeds_mm_s = [60, 120]
forces_g = [500]
repeats = 15
"""
BOTH_WAYS = [(board, way) for board in ("drum", "taxels") for way in ("to_host", "to_board")]


def damage(harness: EngineHarness, rate: float) -> None:
    """Flip a bit in this share of the bytes of both cables, both ways."""
    for board, way in BOTH_WAYS:
        harness.rig.faults.corrupt_bytes(board, way, rate)


def test_one_damaged_byte_in_10_000_costs_no_third_attempt(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        damage(harness, 1e-4)
        await until_ended(harness)

    harness.run(scenario, harness.request(MANY))
    with open_session(harness.session) as session:
        rows = session.trials[session.committed()]
        early = int((rows["attempt"] <= 2).sum())
        assert len(session.gaps) > 200
    assert early >= 0.99 * 60
    assert not harness.texts("pause")
    assert verify(harness.session).whole
    usable = join_sessions([harness.session]).without_gaps()
    assert len(usable.trials) == len(rows)


def test_one_damaged_byte_in_1000_pauses_and_says_what_to_look_at(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        damage(harness, 1e-3)
        await harness.until(lambda: "noisy link" in run.status().reasons)
        await harness.wait(90)
        assert run.status().reasons == ("noisy link",), "it waits for better times, not a minute"
        damage(harness, 0.0)
        await until_ended(harness)

    harness.run(scenario, harness.request(MANY.replace("repeats = 15", "repeats = 1")))
    (text,) = [text for text in harness.texts("link") if "lost on the link" in text]
    assert "look at the taxel board's cable" in text
    assert harness.engine.run is not None and harness.engine.run.complete
    assert verify(harness.session).whole


@pytest.mark.parametrize("seconds", [0.4])
def test_a_single_long_gap_is_no_noise(harness: EngineHarness, seconds: float) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.wait(15)
        harness.rig.faults.stall("taxels")
        harness.rig.faults.stall_computer(seconds)
        harness.rig.faults.stall("taxels", False)
        await until_ended(harness)

    harness.run(scenario, harness.request(MANY.replace("repeats = 15", "repeats = 1")))
    assert not harness.texts("pause")
    assert harness.engine.run is not None and harness.engine.run.complete
