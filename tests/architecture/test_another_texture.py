"""Worked example: a printed texture for bench and simulation is one TOML, the world file."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.bench.plate_solids import drum_plate
from rigctl.bench.textures import find_texture, plate_names
from rigctl.bench.world_file import load_world, world_from_header
from rigctl.errors import WrongUse
from rigctl.rig import open_rig
from rigctl.session.session import Session
from tests.architecture.imports import CHECKOUT
from tests.engine.engine_harness import engine_on

WORLD = """\
[plates."linen 2"]
group = "waves"
height_mm = 2.0
space_mm = 5.0
"""
PROTOCOL = """
name = "linen"
textures = ["A", "linen 2"]
speeds_mm_s = [100]
forces_g = [500]
"""


@pytest.fixture
def world_file(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text(WORLD)
    return path


def test_it_is_pressed_like_any_plate(world_file: Path, tmp_path: Path) -> None:
    world = load_world(world_file)
    with engine_on(open_rig("virtual", seed=3, paced=False, world=world), tmp_path) as harness:
        harness.record(PROTOCOL)
        session = harness.session
    with Session.open(session) as recorded:
        textures = [str(row["texture"]) for row in recorded.trials]
        assert textures == ["A", "linen 2"]
        smooth, waves = (recorded.samples(n).std(axis=0).mean() for n in range(2))
        assert waves > 3 * smooth
        assert world_from_header(recorded.header.simulation, session) == world


def test_it_is_printed(world_file: Path) -> None:
    parameters = load_world(world_file).parameters
    assert plate_names(parameters)[-1] == "linen 2"
    low, high = (
        drum_plate(find_texture(name, parameters), parameters).bounding_box()
        for name in ("A", "linen 2")
    )
    assert high[3] - low[3] == pytest.approx(2.0, abs=0.1)  # the crest is beside the highest point


def test_a_plate_that_nobody_described_is_refused(world_file: Path) -> None:
    with pytest.raises(WrongUse, match=r"A to P, a world file adds others by \[plates.NAME\]"):
        find_texture("felt", load_world(world_file).parameters)


def test_the_page_shows_the_file() -> None:
    page = (CHECKOUT / "docs/how-to/add-a-texture.md").read_text(encoding="utf-8")
    assert WORLD in page and PROTOCOL in page
