"""An engine whose encoder takes conductances, on a sensor with another wiring than the drawing."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.learning_curve import GrowingCurve
from rigctl.config.rig_config import EncoderConfig, RigConfig, TaxelArray
from rigctl.encoder.encoder import encode_trial
from rigctl.encoder.reading import Reading
from rigctl.engine.live_file import LiveReader
from rigctl.errors import WrongUse
from tests.engine.engine_harness import (
    TINY,
    EngineHarness,
    open_harness,
    open_session,
    until_ended,
)

WIRING = tuple(np.random.default_rng(5).permutation(18).tolist())
MANY = TINY.replace("repeats = 1", "repeats = 8")
CONFIG = RigConfig(encoder=EncoderConfig(reading="conductance"), taxels=TaxelArray(wiring=WIRING))
EARLY_END = "\n[early_end]\nhalf_width_hz = 5.0\nleast_trials = 5\n"


async def measured_then_ended(harness: EngineHarness) -> None:
    """Measure the range while the drum hangs free, so that it stays, and wait for the run's end."""
    boards = harness.engine.boards
    boards.use_range(await boards.observe_range(asyncio.sleep(0.5)))
    await until_ended(harness)


def test_live_spikes_equal_those_of_the_recorded_counts(tmp_path: Path) -> None:
    with open_harness(tmp_path, config=CONFIG) as harness:
        harness.run(measured_then_ended, harness.request())
        ranges = harness.engine.boards.encoder.normalisation
        status = harness.engine.status()
        assert (status.reading, status.wiring) == (Reading.CONDUCTANCE, WIRING)
        reader = LiveReader(tmp_path / "live.ring")
        live = reader.taxels(20_000)
        reader.close()
        session = open_session(harness.session)
    assert ranges.reading is Reading.CONDUCTANCE
    with session:
        assert session.header.encoder_reading == "conductance"
        row = int(session.committed()[-1])
        window, readings = session.window(row), session.readings(row)
        assert not np.array_equal(readings, window.samples) and window.samples.max() <= 1023
        first = int(np.searchsorted(live.counters, window.first_counter))
        shown = live.spikes[first : first + len(readings)]
        assert np.array_equal(live.samples[first : first + len(readings)], window.samples)
        spikes = encode_trial(readings, ranges, session.header.encoder_parameters)
        for train in range(spikes.n_trains):
            found = np.repeat(np.arange(len(readings)), shown[:, train])
            assert np.array_equal(found, spikes.train(train))
        assert shown.sum() > 100
        growing = GrowingCurve(harness.session)
        growing.update()
        assert len(growing.features) == 4
        growing.session.close()


def test_an_early_end_needs_ranges_in_counts(tmp_path: Path) -> None:
    async def refused(harness: EngineHarness) -> None:
        protocol = harness.request(MANY + EARLY_END).protocol
        with pytest.raises(WrongUse, match=r"early_end needs .* reading = \"counts\""):
            await harness.handle("start", {"protocol": protocol, "out": str(harness.session)})

    with open_harness(tmp_path, config=CONFIG) as harness:
        harness.run(refused)
