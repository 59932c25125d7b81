"""Stimulation patterns: limits that hold for any spikes, and the files that scripts read."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.analysis.settings import StimulationSettings, load_settings
from rigctl.analysis.stimulation import Channel, channels_of, pulses_of
from rigctl.cli import main
from rigctl.errors import ConfigError, WrongUse
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import Spikes
from tests.analysis.recordings import record

PAPER = SensorLayout.default(18)


def made_spikes(trains: list[list[int]]) -> Spikes:
    starts = np.concatenate([[0], np.cumsum([len(train) for train in trains])]).astype(np.int64)
    joined = np.array([sample for train in trains for sample in train], np.int32)
    return Spikes(starts, joined, 3000)


@given(
    trains=st.lists(st.lists(st.integers(0, 2999), max_size=400), min_size=2, max_size=2),
    refractory_ms=st.floats(0.5, 40),
    max_rate_hz=st.floats(5, 400),
    charge=st.floats(1, 2000),
    seed=st.integers(0, 99),
)
def test_no_limit_is_broken_and_every_spike_is_accounted_for(
    trains: list[list[int]], refractory_ms: float, max_rate_hz: float, charge: float, seed: int
) -> None:
    settings = StimulationSettings(
        refractory_ms=refractory_ms, max_rate_hz=max_rate_hz, max_charge_nc_per_s=charge
    )
    spikes = made_spikes([sorted(set(train)) for train in trains])
    reading = np.random.default_rng(seed).random((3000, 1))
    (pulses,) = pulses_of(spikes, reading, [Channel("both", (0, 1))], settings)
    at, ua = pulses.at_us.tolist(), pulses.amplitude_ua
    assert all(b - a >= 1000 * refractory_ms for a, b in pairwise(at))
    nc = ua * settings.phase_us / 1000
    assert (nc <= settings.max_phase_charge_nc + 1e-9).all() and (ua >= 20).all()
    for number, time in enumerate(at):
        recent = [one for one in at[: number + 1] if one > time - 200_000]
        assert len(recent) <= max_rate_hz * 0.2
        second = [i for i in range(number + 1) if at[i] > time - 1_000_000]
        assert nc[second].sum() <= charge + 1e-6
    dropped = sum(n for name, n in pulses.taken.items() if name != "charge a phase")
    assert len(at) + dropped == len(set(trains[0]) | set(trains[1]))


def test_an_amplitude_follows_the_reading_up_to_the_charge_of_a_phase() -> None:
    spikes = made_spikes([[10, 20, 30], []])
    reading = np.zeros((3000, 1))
    reading[[10, 20, 30], 0] = 0.0, 0.5, 1.0
    settings = StimulationSettings(max_phase_charge_nc=12.0)
    (pulses,) = pulses_of(spikes, reading, [Channel("SA-1", (0,))], settings)
    assert pulses.amplitude_ua.tolist() == [20.0, 50.0, 60.0]
    assert pulses.taken == {"charge a phase": 1}


def test_channels_are_trains_or_what_a_file_names(tmp_path: Path) -> None:
    assert [one.name for one in channels_of(StimulationSettings(), PAPER)][:2] == ["SAI-1", "SAI-2"]
    chosen = replace(StimulationSettings(), channels=("SA layer I", "RA row 2"))
    assert [one.rows for one in channels_of(chosen, PAPER)] == [
        tuple(range(9)), (21, 22, 23, 30, 31, 32),
    ]  # fmt: skip
    with pytest.raises(WrongUse, match="there is no layer IV"):
        channels_of(replace(chosen, channels=("layer IV",)), PAPER)
    file = tmp_path / "file.toml"
    file.write_text("[stimulation]\nphase_us = 4000\n")
    message = "line 2: stimulation.phase_us: a pulse of 8.05 ms is longer than refractory_ms 5"
    with pytest.raises(ConfigError, match=message):
        load_settings(file)


def test_a_trials_pulses_are_written_for_people_and_for_scripts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = record(tmp_path / "session", "AB", travel_mm=24.0)
    file = tmp_path / "file.toml"
    file.write_text('[stimulation]\nchannels = ["SA layer I", "taxel 4"]\n')
    words = ["encode", str(session), "--trial", "3", "--settings", str(file), "--no-cache"]
    for name in ("pulses.csv", "pulses.json"):
        assert main([*words, "--stimulation", str(tmp_path / name)]) == 0
        assert "pulses on 2 channels; spikes without a pulse: " in capsys.readouterr().out
    lines = (tmp_path / "pulses.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# trial 3, Simulated bench")
    rows = list(csv.DictReader(lines[1:]))
    times = [int(row["at_us"]) for row in rows]
    assert times == sorted(times) and {row["name"] for row in rows} == {"SA layer I", "taxel 4"}
    pattern = json.loads((tmp_path / "pulses.json").read_text(encoding="utf-8"))
    assert pattern["settings"]["refractory_ms"] == 5.0
    first = pattern["channels"][0]
    assert first["at_us"] == [int(row["at_us"]) for row in rows if row["channel"] == "1"]
    assert main([*words, "--stimulation", str(tmp_path / "pulses.csv")]) == 2
    assert main([*words, "--stimulation", str(tmp_path / "pulses.bin")]) == 2
    assert "a stimulation pattern is .csv or .json" in capsys.readouterr().err
