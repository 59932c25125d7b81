"""Gain, noise and ageing of a sensor's taxels over its sessions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.sensor_history import SensorHistory, sensor_history, table_lines
from rigctl.cli import main
from rigctl.encoder.reading import Reading
from rigctl.errors import WrongUse
from tests.analysis.recordings import record


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("history")
    return [
        record(folder / name, "AB", repeats=2, travel_mm=24.0, seed=seed)
        for name, seed in (("one", 3), ("two", 4))
    ]


def test_equal_sessions_have_gain_one_and_the_noise_of_their_trials(sessions: list[Path]) -> None:
    found = sensor_history(sessions, reading=Reading.COUNTS)
    assert found.trials == (6, 6) and found.gain.shape == (2, 18)
    assert found.gain[0] == pytest.approx(np.ones(18))
    assert found.gain[1] == pytest.approx(np.ones(18), abs=0.01)
    assert (found.noise < 0.01).all() and (found.noise > 0).all()
    assert np.isnan(found.ageing).all()  # of one day
    assert "not measured in 30 days" in table_lines(found)[-1]


def test_ageing_is_the_slope_of_the_gain(sessions: list[Path]) -> None:
    found = sensor_history(sessions, reading=Reading.COUNTS)
    gain = np.stack([np.ones(18), np.where(np.arange(18) == 4, 0.9, 1.0)])
    aged: SensorHistory = replace(found, day=np.array([0.0, 60.0]), gain=gain)
    expected = np.where(np.arange(18) == 4, 0.9**0.5 - 1, 0.0)
    assert aged.ageing == pytest.approx(expected, abs=1e-9)
    assert "taxel  5: gain 0.900" in table_lines(aged)[1 + 2 + 4]


def test_the_command_prints_what_it_measured(
    sessions: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sensor", *map(str, sessions), "--reading", "counts"]
    assert main([*words, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert [one["trials"] for one in plain["sessions"]] == [6, 6]
    assert plain["ageing_per_30_days"] == [None] * 18
    assert main([*words, "--force", "300"]) == 2
    assert "has no trial on plate A at 300 g" in capsys.readouterr().err


def test_a_session_at_other_speeds_is_named(sessions: list[Path], tmp_path: Path) -> None:
    other = record(tmp_path / "other", "A", travel_mm=24.0, speeds=(60,))
    with pytest.raises(WrongUse, match="no reference trial at a speed of the first session's"):
        sensor_history([sessions[0], other], reading=Reading.COUNTS)
