"""A drum controller that restarts inside a trial's window: seen, and never committed."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.session.verify.session import verify
from rigctl.wire.drum.codes import Status
from tests.acquisition.floor import Floor, open_floor, read, until_ended

ONE = """
name = "one"
textures = ["A"]
speeds_mm_s = [60]
forces_g = [500]
repeats = 1
"""


async def reset_inside_the_window(floor: Floor) -> None:
    """Pull the drum's reset while the sync line is high."""

    def is_high() -> bool:
        state = floor.engine.boards.watch.state
        return state is not None and bool(state.status_bits >> Status.SYNC_HIGH & 1)

    await floor.until(is_high)
    await floor.passes(1.0)
    assert is_high()
    assert floor.rig.faults is not None
    floor.rig.faults.reset("drum")
    await until_ended(floor)


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_a_reset_with_sync_high_is_seen_and_the_trial_not_committed(
    tmp_path: Path, kind: str
) -> None:
    with open_floor(tmp_path, rig_kind=kind) as floor:
        floor.play(reset_inside_the_window, floor.order(ONE))
        run = floor.engine.run
        assert run is not None
        assert (run.ending, run.complete) == ("failed", False)
        with read(floor.session) as session:
            assert session.trials["verdict"].tolist() == ["aborted"]
            assert "restarted" in session.trials["reasons"][0]
        assert verify(floor.session).whole
    assert any("drum rebooted and is back" in text for text in floor.texts("board"))
