"""A drum board that restarts inside a trial's window: detected, and the trial repeated."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.boards.drum_codes import Status
from rigctl.session.verify import verify
from tests.engine.engine_harness import EngineHarness, open_harness, open_session, until_ended

ONE = """
name = "one"
textures = ["A"]
speeds_mm_s = [60]
forces_g = [500]
repeats = 1
"""


async def reset_inside_the_window(harness: EngineHarness) -> None:
    """Reset the drum board while the sync line is high."""

    def is_high() -> bool:
        state = harness.engine.boards.drum_poller.state
        return state is not None and bool(state.status_bits >> Status.SYNC_HIGH & 1)

    await harness.until(is_high)
    await harness.wait(1.0)
    assert is_high()
    assert harness.rig.faults is not None
    harness.rig.faults.reset("drum")
    await until_ended(harness)


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_a_reset_with_sync_high_is_detected_and_the_trial_repeated(
    tmp_path: Path, kind: str
) -> None:
    with open_harness(tmp_path, rig_kind=kind) as harness:
        harness.run(reset_inside_the_window, harness.request(ONE))
        run = harness.engine.run
        assert run is not None
        assert (run.outcome, run.complete) == ("done", True)
        with open_session(harness.session) as session:
            assert session.trials["verdict"].tolist() == ["aborted", "committed"]
            assert "restarted" in session.trials["reasons"][0]
        assert verify(harness.session).whole
    assert any("drum board rebooted and is back" in text for text in harness.texts("board"))
