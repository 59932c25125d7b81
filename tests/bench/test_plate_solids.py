"""The plates to print: whole solids, with the heights that the simulated bench presses."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rigctl.bench import plate_solids
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.textures import CATALOGUE, OVERHANG_MM, printed_heights
from rigctl.cli import main

NOMINAL = WorldParameters()
BACK_MM = plate_solids.THICKNESS_MM


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which the command has written all plates."""
    out = tmp_path_factory.mktemp("plates") / "new"
    assert main(["plates", "--out", str(out)]) == 0
    return out


def names() -> list[str]:
    return [*(f"drum-{name}" for name in CATALOGUE), *(f"flat-{name}" for name in "ABDLN")]


def test_the_command_writes_each_plate_once(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(f"{n}.stl" for n in names())


@pytest.mark.parametrize("name", names())
def test_a_plate_is_one_watertight_solid(folder: Path, name: str) -> None:
    mesh = trimesh.load_mesh(folder / f"{name}.stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 36 * 300 * 2.5


def test_an_open_shell_is_found(folder: Path) -> None:
    mesh = trimesh.load_mesh(folder / "flat-A.stl")
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    assert not mesh.is_watertight


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_a_drum_plate_has_the_heights_of_the_simulated_bench(folder: Path, name: str) -> None:
    mesh = trimesh.load_mesh(folder / f"drum-{name}.stl")
    radius_mm = NOMINAL.circumference_mm / (2 * pi)
    edge = mesh.vertices[mesh.vertices[:, 2] == 0]
    out_mm = np.hypot(edge[:, 0], edge[:, 1]) - radius_mm
    edge, out_mm = edge[out_mm > -0.01], out_mm[out_mm > -0.01]
    travel_mm = np.arctan2(edge[:, 0], edge[:, 1]) * radius_mm
    travel_mm = np.where(travel_mm < -OVERHANG_MM - 0.01, travel_mm + 400.0, travel_mm)
    inside = (travel_mm > 1) & (travel_mm < NOMINAL.plate_length_mm - 1)
    expected = printed_heights(CATALOGUE[name], travel_mm[inside], NOMINAL)
    either_side = [
        printed_heights(CATALOGUE[name], travel_mm[inside] + shift_mm, NOMINAL)
        for shift_mm in (-0.002, 0.002)
    ]
    error_mm = np.min(np.abs(out_mm[inside] - np.stack([expected, *either_side])), axis=0)
    assert inside.sum() > 20
    assert error_mm.max() < 0.03  # the steep foot of a circular ridge


def test_the_flat_plates_have_the_papers_size(folder: Path) -> None:
    for name in "ABDLN":
        length_mm, _, width_mm = trimesh.load_mesh(folder / f"flat-{name}.stl").extents
        assert (length_mm, width_mm) == pytest.approx((300, 36))


def test_a_label_is_cut_into_the_back() -> None:
    plate = plate_solids.flat_plate(CATALOGUE["A"], NOMINAL, 300.0).rotate((90.0, 0.0, 0.0))
    whole_mm2 = plate.slice(-1.0).area()
    assert whole_mm2 == pytest.approx(300 * 36)
    assert plate.slice(plate_solids.LABEL_DEPTH_MM / 2 - BACK_MM).area() < whole_mm2 - 20


def test_a_drum_of_another_radius_gets_its_own_plates(tmp_path: Path) -> None:
    parameters = plate_solids.fitted_to_drum(NOMINAL, 52.0)
    solid = plate_solids.drum_plate(CATALOGUE["B"], parameters)
    plate_solids.write_stl(tmp_path / "B.stl", solid, "B")
    mesh = trimesh.load_mesh(tmp_path / "B.stl")
    assert mesh.is_watertight
    inside_mm = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    assert np.count_nonzero(np.abs(inside_mm - 52.0) < 0.01) > 500


@pytest.mark.parametrize("radius", ["200", "-60", "wide"])
def test_a_drum_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], radius: str
) -> None:
    assert main(["plates", "--out", str(tmp_path / "new"), "--drum-radius", radius]) == 2
    assert "give a number from 50 to 92" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_folder_that_exists_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plates", "--out", str(tmp_path)]) == 2
    assert "name a new folder" in capsys.readouterr().err
