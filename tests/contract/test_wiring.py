"""A sensor wired as drawn has each taxel at its place, on both kinds of simulated boards."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from rigctl.values import DRAWN_WIRING, Block

BOTTOM = (3, 4, 5, 9, 10, 11, 15, 16, 17)
"""Readings of inputs A3 to A5, which the drawing leads to the bottom layer."""
ROW = (6, 7, 8, 9, 10, 11)
"""Readings of line 2, the second row of both layers."""
NOISE_COUNTS = 3
"""A dead taxel reads no more than the converter's own noise."""


@pytest.mark.parametrize("kind", [VIRTUAL, FIRMWARE])
@pytest.mark.parametrize(
    ("dead", "places"), [(BOTTOM, range(9, 18)), (ROW, (3, 4, 5, 12, 13, 14)), ((13,), (7,))]
)
def test_dead_readings_are_dead_places(
    kind: str, dead: tuple[int, ...], places: tuple[int, ...], request: pytest.FixtureRequest
) -> None:
    if kind == FIRMWARE:
        request.getfixturevalue("images")
    rig = open_rig(kind, paced=False, world=SimulatedWorld(WorldParameters(dead_taxels=dead)))
    asyncio.set_event_loop(rig.loop)
    blocks: list[Block] = []
    rig.taxels.on_block(blocks.append)

    async def listen() -> None:
        await rig.taxels.connect()
        await asyncio.sleep(0.2)

    try:
        rig.loop.run_until_complete(listen())
    finally:
        asyncio.set_event_loop(None)
        rig.close()
    samples = np.concatenate([block.samples for block in blocks])
    assert len(samples) > 100
    silent = np.flatnonzero(samples.mean(axis=0) < NOISE_COUNTS)
    assert silent.tolist() == sorted(places) == sorted(map(DRAWN_WIRING.index, dead))
