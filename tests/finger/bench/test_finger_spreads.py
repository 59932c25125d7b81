"""Sets of the moving finger from slides, without what the virtual person spreads."""

from __future__ import annotations

import itertools
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.bench.parameter_fields import describe
from rigctl.bench.parameters import WorldParameters
from rigctl.finger.bench.operator_parameters import OperatorParameters
from rigctl.finger.published import NEW_SESSION, SAME_SESSION
from rigctl.finger.scaled_time import BATCH_SAMPLES
from rigctl.finger.values import ScanKind, Stage, VelocityProfile
from tools import finger_spreads
from tools.finger_spreads import (
    PERSONS,
    SPREADS,
    SlidingFinger,
    draw_places,
    main,
    person,
    simulate_data_set,
)


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make two slides over two plates in each profile and stage."""
    monkeypatch.setattr(finger_spreads, "PLATES", ("A", "D"))
    monkeypatch.setattr(finger_spreads, "REPEATS", dict.fromkeys(Stage, 2))
    monkeypatch.setattr(finger_spreads, "COMPONENTS", 3)
    monkeypatch.setattr(finger_spreads, "DRAWS", 1)


def test_every_spread_is_a_parameter_of_the_person() -> None:
    known = {field.name for field in fields(OperatorParameters)}
    assert all(known.issuperset(names) for names in PERSONS.values())


def test_the_same_seed_makes_the_same_scans(brief: None) -> None:
    one, again = (simulate_data_set(WorldParameters(), OperatorParameters(), 4) for _ in range(2))
    assert np.array_equal(one.training.windows, again.training.windows)
    assert len(one.training) == len(one.calibration) == len(one.tested) == 2 * 2 * 5
    assert one.textures == ("A", "D")


def test_a_person_without_spread_slides_alike_and_over_the_whole_way() -> None:
    still = replace(OperatorParameters(), **dict.fromkeys(PERSONS["without any spread"], 0.0))
    finger = SlidingFinger(WorldParameters(), still, 4, 0)
    scans = [finger.scan("A", VelocityProfile.MEDIUM, Stage.TRAIN) for _ in range(2)]
    assert len({len(scan.readings) for scan in scans}) == 1
    for scan in scans:
        n = len(scan.readings)
        seconds = np.diff([*range(0, n, BATCH_SAMPLES), n]) / 1000
        way_mm = float(np.sum(scan.velocities_um_per_s * seconds)) / 1000
        assert way_mm == pytest.approx(200.0, abs=0.5)
        assert scan.readings.mean() > 60


def test_a_place_in_the_ranges_is_that_of_every_spread_of_its_kind() -> None:
    rows = {row.name: row for row in describe(OperatorParameters())}
    for place, end in ((0.0, "low"), (0.5, "value"), (1.0, "high")):
        found = person(dict.fromkeys(SPREADS, place))
        for name in itertools.chain(*SPREADS.values()):
            assert getattr(found, name) == getattr(rows[name], end)
    places = draw_places(10, 3)
    for what in SPREADS:  # a Latin hypercube: one in each tenth
        assert sorted(int(10 * one[what]) for one in places) == list(range(10))


def test_persons_are_judged_by_the_original_curve_alone(
    brief: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    curve = {"one": (SAME_SESSION, range(2, 4), 65.0), "other": (NEW_SESSION, range(3, 4), 50.0)}
    monkeypatch.setattr(finger_spreads, "CURVE", curve)
    monkeypatch.setattr(finger_spreads, "IDENTIFYING_SEEDS", (11,))
    assert main(["--identify", "3", "--seeds", "4"]) == 0
    lines = capsys.readouterr().out.splitlines()
    persons = np.array([[float(x) for x in line.strip("| ").split("|")] for line in lines[2:5]])
    off = persons[:, 5:7] - [65.0, 50.0]
    np.testing.assert_allclose(persons[:, 7], np.sqrt(np.mean(off**2, axis=1)), atol=0.01)
    assert [line.split(" | ")[0] for line in lines[8:]] == [f"| {what}" for what in SPREADS]
    assert all("identified" in line or "free" in line for line in lines[8:])


def test_the_command_prints_a_row_for_each_person(
    brief: None, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    world = tmp_path / "world.toml"
    world.write_text("plate_tilt_mm = 0.02\n", encoding="utf-8")
    assert main(["--seeds", "4", "--world", str(world)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[0] for row in rows[2:]] == [f"| {name}" for name in PERSONS]
    assert main(["--seeds", "4", "--gains"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[0] for row in rows[2:]] == [f"| {kind}" for kind in ScanKind]
    assert main(["--world", "none.toml"]) == 2
    assert "none.toml" in capsys.readouterr().err
