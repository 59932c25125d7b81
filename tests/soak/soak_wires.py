"""Send noise to both lines. ``make fuzz`` runs it; it is not part of the suite."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.boards.drum_registers import SETTINGS
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.engine.rig import Rig
from rigctl.rig import open_rig
from tests.boards.taxel_encoder import encode_data

DECODER_BYTES = 20_000_000
DRUM_BYTES = 1_000_000
PIECE_BYTES = 400
SILENCE_S = 0.05
"""Longer than a piece at 115,200 baud plus the silence that resets the parser."""


def test_noise_gives_no_taxel_samples() -> None:
    rng = np.random.default_rng(7)
    decoder = FrameDecoder(18)
    for _ in range(DECODER_BYTES // 1_000_000):
        noise = rng.integers(0, 256, 1_000_000, np.uint8).tobytes()
        assert decoder.feed(noise, 0.0).blocks == ()
    rows = np.arange(50)
    quiet = (np.zeros((50, 18), np.uint16), np.zeros(50, np.uint8), np.zeros(50, np.uint8))
    after = decoder.feed(b"\0" + encode_data(rows, *quiet), 0.0)
    assert sum(len(block) for block in after.blocks) == 50


async def _fuzz(rig: Rig, n_bytes: int) -> tuple[dict[str, float], dict[str, float]]:
    """Send noise on the drum's line; return the settings before and after it."""
    rng = np.random.default_rng(8)
    names = [entry.name for entry in SETTINGS if entry.name not in ("heartbeat",)]
    await rig.drum.connect()
    before = await rig.drum.get(*names)
    for _ in range(n_bytes // PIECE_BYTES):
        rig.drum.link.write(rng.integers(0, 256, PIECE_BYTES, np.uint8).tobytes())
        await asyncio.sleep(SILENCE_S)
    return before, await rig.drum.get(*names)


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_noise_changes_no_register(kind: str) -> None:
    rig = open_rig(kind, seed=1, paced=False)
    try:
        before, after = rig.loop.run_until_complete(_fuzz(rig, DRUM_BYTES))
    finally:
        rig.close()
    assert after == before
