"""The board's self-test names broken taxels, on both kinds of simulated boards."""

from __future__ import annotations

import asyncio

import pytest

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.config.rig_config import RigConfig, TaxelArray
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig

WIRING = tuple(range(17, -1, -1))


@pytest.mark.parametrize("kind", [VIRTUAL, FIRMWARE])
def test_dead_taxels_are_named_by_their_place(kind: str, request: pytest.FixtureRequest) -> None:
    if kind == FIRMWARE:
        request.getfixturevalue("images")
    rig = open_rig(
        kind,
        paced=False,
        config=RigConfig(taxels=TaxelArray(wiring=WIRING)),
        world=SimulatedWorld(WorldParameters(dead_taxels=(2, 9))),
    )
    asyncio.set_event_loop(rig.loop)
    try:
        rig.loop.run_until_complete(rig.taxels.connect())
        assert rig.taxels.findings == [
            "taxel 16 (line D4, input A2) does not conduct: it is open or torn",
            "taxel 9 (line D5, input A3) does not conduct: it is open or torn",
        ]
    finally:
        asyncio.set_event_loop(None)
        rig.close()
