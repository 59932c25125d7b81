"""Run each kind of simulated boards for up to an hour of simulated time without any loss.

``make soak`` runs it; the name of the file keeps it out of the suite.
"""

from __future__ import annotations

import asyncio

import pytest

from rigctl.engine.rig import Rig
from rigctl.rig import open_rig
from rigctl.values import Block

WORLD_S = {"virtual": 3600.0, "firmware": 600.0}
POLL_PERIOD_S = {"virtual": 0.04, "firmware": 0.02}


async def _watch(rig: Rig, world_s: float, period_s: float) -> dict[str, int]:
    """Poll and receive for a time; return the numbers of rows, polls and lost samples."""
    rows = 0

    def count(block: Block) -> None:
        nonlocal rows
        rows += len(block)

    rig.taxels.on_block(count)
    await rig.drum.connect()
    await rig.taxels.connect()
    loadcell_lost = polls = 0
    next_s = rig.loop.time()
    end_s = next_s + world_s
    while rig.loop.time() < end_s:
        state = await rig.drum.poll()
        polls += 1
        loadcell_lost += state.loadcell_lost
        next_s += period_s
        await asyncio.sleep(max(0.0, next_s - rig.loop.time()))
    return {"rows": rows, "polls": polls, "loadcell_lost": loadcell_lost}


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_a_long_run_loses_nothing(kind: str) -> None:
    rig = open_rig(kind, seed=1, paced=False)
    try:
        counts = rig.loop.run_until_complete(_watch(rig, WORLD_S[kind], POLL_PERIOD_S[kind]))
        lost = rig.taxels.counters.lost
    finally:
        rig.close()
    assert counts["loadcell_lost"] == 0
    assert lost == 0
    assert counts["rows"] == pytest.approx(WORLD_S[kind] * 1000, rel=0.006)
    assert counts["polls"] >= WORLD_S[kind] / POLL_PERIOD_S[kind] * 0.99
