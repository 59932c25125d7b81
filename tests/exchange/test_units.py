"""Units of labels and of the load cell: every factor, and what a unit needs."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from rigctl.config.toml_reader import TomlText
from rigctl.errors import ConfigError
from rigctl.exchange.column_map import ImportMap, parse_map
from rigctl.exchange.labels import parse_label
from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.values import PlannedTrial
from tests.exchange.test_import import run_import

MAP = """\
[files]
pattern = '(?P<texture>[a-z]+)_(?P<speed>[^_]+)_(?P<force>[^_]+)_'
[time]
rate_hz = 1000
[taxels]
columns = ["1..3"]
[labels]
{labels}
[loadcell]
column = "4"
{loadcell}
"""
GRAMS_PER_N = 101.971621


def read(labels: str = "", loadcell: str = "") -> ImportMap:
    source = MAP.format(labels=labels, loadcell=loadcell)
    return parse_map(TomlText("map.toml", source, ConfigError), "theirs")


def trial_of(name: str, labels: str) -> PlannedTrial:
    label = parse_label(Path(name), read(labels).labels, {}, name)
    return label.trial(1, 1000)


@pytest.mark.parametrize(
    ("value", "labels", "speed_mm_s"),
    [
        ("1200", 'speed_unit = "mm/min"', 20.0),
        ("1.2", 'speed_unit = "m/min"', 20.0),
        ("2", 'speed_unit = "inch/s"', 50.8),
        ("60", 'speed_unit = "inch/min"', 25.4),
        ("30", 'speed_unit = "rpm"\nradius_mm = 60', pi * 60),
        ("-7", "speed_factor = 2.5", 17.5),
    ],
)
def test_speeds_become_mm_per_second(value: str, labels: str, speed_mm_s: float) -> None:
    trial = trial_of(f"silk_{value}_1_.csv", labels)
    assert trial.speed_mm_s == pytest.approx(speed_mm_s)
    assert trial.direction == ("backward" if value.startswith("-") else "forward")


@pytest.mark.parametrize(
    ("value", "labels", "force_g"),
    [
        ("500", 'force_unit = "mN"', 0.5 * GRAMS_PER_N),
        ("20", 'force_unit = "kPa"\narea_mm2 = 100', 2 * GRAMS_PER_N),
        ("3", "force_factor = 453.6", 1360.8),
    ],
)
def test_forces_become_grams(value: str, labels: str, force_g: float) -> None:
    assert trial_of(f"silk_20_{value}_.csv", labels).force_g == pytest.approx(force_g)


def test_a_depth_is_a_trial_in_position() -> None:
    trial = trial_of("silk_20_0.8_.csv", 'force_unit = "mm"')
    assert (trial.force_mode, trial.depth_mm, trial.force_g) == ("position", 0.8, 0.8)


def test_the_load_cell_may_measure_pressure() -> None:
    mapping = read(loadcell='unit = "kPa"\narea_mm2 = 50')
    assert mapping.loadcell_factor == pytest.approx(0.05 * GRAMS_PER_N)
    assert read(loadcell="factor = 12").loadcell_factor == 12


@pytest.mark.parametrize(
    ("labels", "loadcell", "words"),
    [
        ('speed_unit = "rpm"', "", "line 8: labels.speed_unit: rpm needs radius_mm, in mm"),
        ('force_unit = "kPa"', "", "labels.force_unit: kPa needs area_mm2, in mm²"),
        ("", 'unit = "kPa"', "line 11: loadcell.unit: kPa needs area_mm2"),
        ("radius_mm = 60", "", "labels.radius_mm: belongs to speed_unit = 'rpm', not to 'mm/s'"),
        (
            'speed_unit = "rpm"\nradius_mm = 60\nspeed_factor = 2',
            "",
            "line 10: labels.speed_factor: stands in place of speed_unit: give one of them",
        ),
        ('speed_unit = "mph"', "", "must be one of mm/s, cm/s, m/s, mm/min"),
        ('speed_unit = "rpm"\nradius_mm = 0', "", "0 is outside 0.001 to 1e+06 mm"),
        ("speed_factor = 0", "", "labels.speed_factor: 0 is outside"),
        ("", 'unit = "mm"', "loadcell.unit: must be one of g, kg, N, mN, kPa"),
    ],
)
def test_a_unit_without_what_it_needs_is_refused(labels: str, loadcell: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read(labels, loadcell)
    assert words in str(refused.value)


def test_a_session_has_the_depths_of_its_trials(tmp_path: Path) -> None:
    files = []
    for depth in ("0.5", "1"):
        files.append(tmp_path / f"silk_20_{depth}_.npy")
        np.save(files[-1], np.arange(400.0).reshape(100, 4))
    text = MAP.format(labels='force_unit = "mm"', loadcell="")
    folder, inspection = run_import(tmp_path, text, files)
    assert verify(folder).problems == []
    assert inspection.remarks[-1] == "depths in mm stand in the place of grams"
    with Session.open(folder) as session:
        trials = [session.trial_row(index).trial for index in range(2)]
    assert [(t.force_mode, t.depth_mm) for t in trials] == [("position", 0.5), ("position", 1.0)]
