"""Noise on the drum's line, with several seeds: polls repeat in time."""

from __future__ import annotations

import asyncio

import pytest

from rigctl.rig import VIRTUAL, open_rig
from tests.contract.noise import bear_noise
from tests.contract.operator import Operator


@pytest.mark.parametrize("seed", [6, 11, 12, 13, 19, 20, 26, 31])
def test_a_noisy_drum_line_is_tolerated_for_every_seed(seed: int) -> None:
    rig = open_rig(VIRTUAL, seed=seed, paced=False)
    asyncio.set_event_loop(rig.loop)
    operator = Operator(rig)
    try:
        operator.run(operator.connect())
        operator.run(bear_noise(operator))
        assert operator.drum.modbus.retries > 0
        assert operator.drum.modbus.stale == 0
    finally:
        asyncio.set_event_loop(None)
        rig.close()
