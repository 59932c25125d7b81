"""An engine whose encoder scales the force: live spikes are those of the recorded counts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.config.rig_config import EncoderConfig, RigConfig, TaxelArray
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.reading import Reading
from rigctl.engine.engine import Engine
from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.engine.rig import Rig
from rigctl.errors import ConfigError, WrongUse
from rigctl.rig import open_rig
from rigctl.session.sensor_passport import SensorPassport, TaxelResponse, read_passport
from tests.engine.engine_harness import engine_on, open_session
from tests.engine.taxels.test_live_conductance import measured_then_ended

FORCES_G = (100.0, 300.0, 500.0, 1000.0)
TAXELS = tuple(
    TaxelResponse(tuple(scale * force**0.7 for force in FORCES_G), 900.0)
    for scale in np.linspace(3.0, 6.0, 18).tolist()
)
ABOUT = ("S7", "2026-01-01T00:00:00Z", "0" * 64, False)
PASSPORT = SensorPassport(*ABOUT, Reading.CONDUCTANCE, FORCES_G, (0.02,) * 4, TAXELS)
CONFIG = RigConfig(taxels=TaxelArray(passport="sensor.json"))


def rig_file(folder: Path, **encoder: str) -> Path:
    """Write a simulated rig whose sensor has a passport; return its path."""
    (folder / "sensor.json").write_text(json.dumps(PASSPORT.to_values()))
    ports = replace(CONFIG.ports, simulate="virtual")
    path = folder / "rig.toml"
    path.write_text(replace(CONFIG, ports=ports, encoder=EncoderConfig(**encoder)).to_toml())
    return path


@pytest.mark.parametrize("scaling", ["divided", "calibrated"])
def test_live_spikes_equal_those_of_the_recorded_counts(tmp_path: Path, scaling: str) -> None:
    path = rig_file(tmp_path, reading="conductance", force_scaling=scaling)
    with engine_on(open_rig(str(path), seed=3, paced=False), tmp_path) as harness:
        harness.run(measured_then_ended, harness.request())
        ranges = harness.engine.boards.encoder.normalisation
        reader = LiveReader(tmp_path / "live.ring")
        live = reader.taxels(20_000)
        reader.close()
        session = open_session(harness.session)
    with session:
        assert session.header.encoder_scaling == scaling
        assert read_passport(session.header.passport) == PASSPORT
        assert Path(session.config.taxels.passport) == tmp_path / "sensor.json"
        row = int(session.committed()[-1])
        window, readings = session.window(row), session.readings(row)
        first = int(np.searchsorted(live.counters, window.first_counter))
        shown = live.spikes[first : first + len(readings)]
        parameters, gain = session.header.encoder_parameters, session.header.gain(ranges)
    assert gain is not None
    (spikes,) = encode_trials([readings], ranges, parameters, gains=[gain])
    (plain,) = encode_trials([readings], ranges, parameters)
    for train in range(spikes.n_trains):
        found = np.repeat(np.arange(len(readings)), shown[:, train])
        np.testing.assert_array_equal(found, spikes.train(train))
    assert len(spikes.sample_index) != len(plain.sample_index)


def make_engine(rig: Rig, ring: Path) -> None:
    """Make an engine, as a run does before anything moves."""
    live = LiveWriter(ring, rig.config.taxels.count)
    try:
        Engine(rig, live, lambda: "2026-01-02T03:04:05+00:00", real_time=False)
    finally:
        live.close()
        rig.close()


def test_a_calibrated_encoder_says_what_it_lacks(tmp_path: Path) -> None:
    counts = rig_file(tmp_path, force_scaling="calibrated")
    with pytest.raises(WrongUse, match=r'set \[encoder\] reading = "conductance"'):
        make_engine(open_rig(str(counts), paced=False), tmp_path / "one.ring")
    (tmp_path / "sensor.json").unlink()
    with pytest.raises(ConfigError, match=r"sensor\.json cannot be read"):
        open_rig(str(counts), paced=False)
    config = RigConfig(encoder=EncoderConfig(reading="conductance", force_scaling="calibrated"))
    with pytest.raises(WrongUse, match="needs the sensor's passport: run rigctl calibrate"):
        make_engine(open_rig("virtual", paced=False, config=config), tmp_path / "two.ring")
