"""Calibration of load cell, force loop and imbalance on the virtual rig, by command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rigctl.cli import main
from rigctl.engine.calibration_values import MassReading
from rigctl.engine.load_cell_scale import fit_scale, validate_masses
from rigctl.errors import WrongUse

MINE = """\
# My rig, since March.
[about]
name = "drum 2"  # in the corner

[loadcell]
scale_ug_per_count = 2000  # µg/count: old
"""


def test_the_scale_is_a_line_through_all_readings() -> None:
    points = [
        MassReading(0, 80_000, 100),
        MassReading(200, 163_333, 100),
        MassReading(500, 288_333, 100),
    ]
    scale = fit_scale(points)
    assert scale.ug_per_count == 2400
    assert scale.nonlinearity_share < 1e-3


def test_a_bridge_wired_the_other_way_gives_a_negative_scale() -> None:
    assert fit_scale([MassReading(0, 1000, 5), MassReading(500, -207_333, 5)]).ug_per_count == -2400


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (
            [MassReading(0, 80_000, 50), MassReading(500, 80_100, 50)],
            "that the mass is on the drum",
        ),
        ([MassReading(0, 80_000, 50), MassReading(500, 288_000, 9000)], "unstable"),
        (
            [MassReading(0, 0, 5), MassReading(200, 100_000, 5), MassReading(400, 150_000, 5)],
            "not proportional to the masses",
        ),
        ([MassReading(0, 80_000, 5), MassReading(500, 8_388_607, 0)], "end of its range"),
        ([MassReading(0, 0, 1), MassReading(5000, 1000, 1)], "is impossible"),
        (
            [MassReading(0, 0, 50), MassReading(50, 500_000, 50)],
            r"100 µg per count is impossible \(200 to 25000 are possible\)",
        ),
    ],
)
def test_impossible_readings_are_refused_with_a_sentence(
    points: list[MassReading], sentence: str
) -> None:
    with pytest.raises(WrongUse, match=sentence):
        fit_scale(points)


@pytest.mark.parametrize("masses", [[], [0.0], [-5.0], [500.0, 500.0]])
def test_invalid_masses_are_refused(masses: list[float]) -> None:
    with pytest.raises(WrongUse, match="known mass"):
        validate_masses(masses)


def calibrated(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, object]:
    """Return the command's JSON output on the virtual rig."""
    assert main(["calibrate", "--rig", "virtual", "--seed", "4", "--yes", "--json", *words]) == 0
    result: dict[str, object] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return result


def test_the_command_finds_the_scale_of_the_virtual_load_cell(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = calibrated(capsys, "loadcell", "--mass", "500", "--mass", "200")
    assert result["scale_ug_per_count"] == pytest.approx(2400, rel=0.005)
    assert result["kept_in"] == ["the board's EEPROM"]


def test_the_command_finds_gains_at_a_held_force(capsys: pytest.CaptureFixture[str]) -> None:
    result = calibrated(capsys, "force", "--force", "400")
    assert result["gain_p_per_s"] == pytest.approx(7.5, abs=3.5)
    assert result["stiffness_g_per_mm"] == pytest.approx(650, abs=250)
    assert result["actuator_mm_s"] == pytest.approx(10, rel=0.15)
    assert result["dead_band_percent"] == pytest.approx(8, abs=4)
    assert result["stiction_percent"] == pytest.approx(1, abs=6)
    assert 0 < float(str(result["held_within_g"])) < 8


def test_the_command_finds_the_imbalance(capsys: pytest.CaptureFixture[str]) -> None:
    table = calibrated(capsys, "imbalance")["table_g"]
    assert isinstance(table, list)
    assert (max(table) - min(table)) / 2 == pytest.approx(1.0, abs=0.3)


def test_wrong_use_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "--rig", "virtual", "loadcell", "--mass", "-1"]) == 2
    assert "known mass" in capsys.readouterr().err
    words = ["calibrate", "--rig", "virtual", "--yes", "force", "--force", "9000"]
    assert main(words) == 2
    assert "this rig presses with" in capsys.readouterr().err


def test_the_command_tares_another_drum_only_with_anyway(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    counts = calibrated(capsys, "tare")["tare_counts"]
    assert counts == pytest.approx(80_000, abs=500)
    assert calibrated(capsys, "tare", "--anyway")["tare_counts"] == pytest.approx(counts, abs=500)
