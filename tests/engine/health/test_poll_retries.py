"""Noise on the drum's line during a run: counted in the status, no trial lost."""

from __future__ import annotations

from pathlib import Path

from rigctl.bench.simulated_rig import DRUM, TO_BOARD, TO_HOST
from tests.cli.processes import ONE
from tests.engine.engine_harness import EngineHarness, open_harness, until_ended

SEED = 3
"""With some seeds the noise hits all requests of 250 ms, and the drum rightly lifts."""


def test_a_run_over_a_noisy_drum_line_completes_and_counts_retries(tmp_path: Path) -> None:
    async def with_noise(harness: EngineHarness) -> None:
        assert harness.engine.status().poll_retries == 0
        assert harness.rig.faults is not None
        harness.rig.faults.corrupt_bytes(DRUM, TO_BOARD, 0.01)
        harness.rig.faults.corrupt_bytes(DRUM, TO_HOST, 0.002)
        await until_ended(harness)

    with open_harness(tmp_path, SEED) as harness:
        harness.run(with_noise, harness.request(ONE))
        run = harness.engine.run
        assert run is not None
        assert (run.outcome, harness.texts("link")) == ("done", [])
        assert harness.engine.status().poll_retries > 10
