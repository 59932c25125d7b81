"""World files: every parameter can be set, and every mistake is reported with its line."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.bench.parameter_fields import ParameterInfo
from rigctl.bench.parameters import (
    IDENTIFIED,
    Plate,
    WorldParameters,
    parameter_infos,
)
from rigctl.bench.textures import CATALOGUE, find_texture, printed_heights
from rigctl.bench.world_file import (
    NOMINAL_WORLD,
    SimulatedWorld,
    format_world,
    load_world,
    parse_world,
    world_from_header,
)
from rigctl.config.resources import find_protocol, protocols
from rigctl.config.toml_reader import TomlText
from rigctl.errors import ConfigError, SessionError
from rigctl.protocol.loader import load_protocol

READINGS = st.lists(st.integers(0, 17), max_size=18, unique=True).map(tuple)
DRUM = {"circumference_mm", "plate_start_mm", "plate_length_mm"}
"""Parameters that depend on each other."""


def parsed(text: str, name: str = "world.toml") -> WorldParameters:
    return parse_world(TomlText(name, text, ConfigError))


def between(row: ParameterInfo) -> st.SearchStrategy[float]:
    return st.floats(row.low, row.high)


RIDGES = st.builds(
    Plate,
    st.sampled_from("ABCDEFGHIJKLMNOP"),
    st.sampled_from(["circular ridges", "rectangular ridges", "waves"]),
    st.floats(0.1, 4),
    st.floats(1, 20),
    st.floats(0.1, 0.9),
)
PLATES = st.lists(RIDGES, max_size=4, unique_by=lambda plate: plate.name).map(tuple)

WORLDS = st.fixed_dictionaries(
    {row.name: between(row) for row in parameter_infos() if row.name not in DRUM}
    | {"dead_taxels": READINGS, "stuck_taxels": READINGS, "plates": PLATES}
).map(lambda values: replace(WorldParameters(), **values))


@given(WORLDS)
def test_a_printed_world_reads_back_equal(world: WorldParameters) -> None:
    assert parsed(format_world(world)) == world


@pytest.mark.parametrize("row", parameter_infos(), ids=lambda row: row.name)
def test_every_parameter_is_printed_with_its_meaning_and_range_checked(
    row: ParameterInfo,
) -> None:
    (line,) = [
        text
        for text in format_world(NOMINAL_WORLD.parameters).splitlines()
        if text.startswith(f"{row.name} = ")
    ]
    assert line.endswith(f"{row.unit}: {row.doc}".removeprefix(": "))
    for wrong in (row.low - 1e-3 * (1 + abs(row.low)), row.high + 1e-3 * (1 + abs(row.high))):
        with pytest.raises(ConfigError, match=f"lab, line 2: {row.name}: .* is outside"):
            parsed(f"\n{row.name} = {wrong!r}", "lab")


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text("# ours\nstart_mm = 100\nstuck_taxels = [3, 17]\n", encoding="utf-8")
    wanted = replace(WorldParameters(), start_mm=100.0, stuck_taxels=(3, 17))
    assert load_world(path) == SimulatedWorld(wanted, "lab.toml")
    assert parsed("") == WorldParameters()


def test_the_papers_world_changes_only_what_identification_may_change() -> None:
    world = asdict(load_world(protocols() / "worlds" / "paper.toml").parameters)
    nominal = asdict(WorldParameters())
    changed = {name for name, value in world.items() if value != nominal[name]}
    identified = {row.name for row in parameter_infos() if row.source == IDENTIFIED}
    assert changed <= identified | {"relaxation_s"}
    assert world["loadcell_drag"] > nominal["loadcell_drag"] == 0.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("start_mn = 3", ["line 1: start_mn", "did you mean 'start_mm', in mm?"]),
        ("start_inch = 3", ["line 1: start_inch", "did you mean 'start_mm', in mm?"]),
        ("\ndeadband = 0.1", ["line 2: deadband", "did you mean 'dead_band', in duty?"]),
        ("[geology]\ndepth = 1", ["line 1: geology", "`rigctl world` prints them"]),
        ("start_mm = '3 mm'", ["line 1: start_mm", "must be a number, not '3 mm'"]),
        ("start_mm = true", ["line 1: start_mm", "must be a number, not true"]),
        ("start_mm = nan", ["line 1: start_mm", "nan is outside 0 to 400 mm"]),
        ("start_mm = -inf", ["line 1: start_mm", "-inf is outside"]),
        ("start_mm = [1]", ["line 1: start_mm", "must be a number"]),
        ("# taxels\ndead_taxels = [1024]", ["line 2: dead_taxels", "1024 is outside 0 to 1023"]),
        ("stuck_taxels = [1.5]", ["line 1: stuck_taxels", "whole numbers"]),
        ("dead_taxels = 3", ["line 1: dead_taxels", "list of whole numbers"]),
        ("circumference_mm = 350", ["line 1", "the plate would end at 380 mm, beyond the turn"]),
        ("circumference_mm = 390\nplate_length_mm = 385", ["line 2: plate_length_mm", "395 mm"]),
        ("start_mm\nstop_mm", ["not TOML", "line 1"]),
        ("[plates.Q]\nheight_mm = 1", ["line 1: plates.Q", "group"]),
        ("[plates.'a/b']\ngroup = 'waves'", ["line 1: plates.a/b", "contains '/'"]),
        ("[plate.B]\nheight_mm = 1", ["line 1: plate", "did you mean 'plates'?"]),
        ("\nplates.B.space_mm = 0", ["line 2: plates.B.space_mm", "outside 1 to 20 mm"]),
        ("\nplates = {B = {space_mm = 0}}", ["line 2: plates.B.space_mm", "outside"]),
        ("[plates.B]\nheigth_mm = 1", ["line 2: plates.B.heigth_mm", "mean 'height_mm'?"]),
        ("[plates.B]\n\nspace_mm = 0", ["line 3: plates.B.space_mm", "outside 1 to 20 mm"]),
        ("[plates.B]\ngroup = 'wave'", ["line 2: plates.B.group", "did you mean 'waves'?"]),
        ("[plates.A]\nheight_mm = 1", ["line 2: plates.A.height_mm", "a smooth plate has none"]),
        ("plates = 3", ["line 1: plates", "must be a table"]),
        ("[plates]\nB = 3", ["line 2: plates.B", "must be a table, written [plates.B]"]),
    ],
)
def test_a_mistake_names_file_line_and_remedy(text: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as refused:
        parsed(text, "lab.toml")
    sentence = str(refused.value)
    assert sentence.startswith("lab.toml") and "\n" not in sentence
    assert all(word in sentence for word in words), sentence


def test_the_how_to_shows_a_world_file_and_the_sentence_of_a_wrong_one() -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / "rehearse.md"
    shown = page.read_text(encoding="utf-8")
    example = shown.split("```toml\n")[1].split("```")[0]
    description = SimulatedWorld(parsed(example)).rig_config()
    for protocol in ("quick", "paper"):  # which the page has run in this world
        load_protocol(find_protocol(protocol), description)
    with pytest.raises(ConfigError) as refused:
        parsed(example.replace("speed_mm_s", "speed_in_s"), "lab.toml")
    assert f"rigctl: {refused.value}\n" in shown


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot read .*absent\.toml: No such file"):
        load_world(tmp_path / "absent.toml")


def test_the_header_of_a_session_restores_the_same_world() -> None:
    world = SimulatedWorld(replace(WorldParameters(), start_mm=5.0, dead_taxels=(2,)), "lab.toml")
    world = world._replace(
        parameters=replace(world.parameters, plates=(Plate("B", "waves", 1.25),))
    )
    header = json.loads(json.dumps(world.header_fields()))
    assert world_from_header(header, Path("s")) == world
    assert world_from_header({"seed": 1}, Path("s")) is None
    header["world"]["warp"] = header["world"].pop("start_mm")
    with pytest.raises(SessionError, match="s was recorded in the world of another version"):
        world_from_header(header, Path("s"))


def test_a_labs_own_plate_has_its_height_and_spacing() -> None:
    text = 'base_height_mm = 0.5\n[plates.C]\ngroup = "waves"\nheight_mm = 1.5\nspace_mm = 5\n'
    world = parsed(text + "[plates.G]\nridge_share = 0.2\n[plates.L]\ngroup = 'smooth'")
    along_mm = np.arange(0.0, 20.0, 0.01)
    waves, ridges, smooth, other = (
        printed_heights(find_texture(name, world), along_mm, world) for name in "CGLH"
    )
    assert waves.max() == pytest.approx(1.5)
    assert np.flatnonzero(np.diff(np.sign(np.diff(waves))) < 0).size == 4
    one = round(100 * world.base_space_mm)
    assert np.mean(ridges[:one] > 0) == pytest.approx(0.2, abs=0.01)
    assert ridges.max() == pytest.approx(0.5)
    assert not smooth.any()
    assert other.max() == pytest.approx(CATALOGUE["H"].height * 0.5)


def test_the_default_rig_description_fits_its_world() -> None:
    text = "circumference_mm = 500\nplate_length_mm = 380\nloadcell_ug_per_count = 3000"
    described = SimulatedWorld(parsed(text)).rig_config()
    assert described.drum.circumference_mm == 500
    assert described.drum.plate_length_mm == 380
    assert described.loadcell.scale_ug_per_count == 3000
    assert {f.name for f in fields(described.drum)} >= DRUM


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("plates", 1),
        ("plates", [1]),
        ("plates", [{"name": "A"}]),
        ("plates", [{"nosuch": "A", "group": "x"}]),
        ("plates", [{**asdict(Plate("B", "waves")), "height_mm": 1e9}]),
        ("plates", [asdict(Plate("../x", "waves"))]),
        ("plates", [asdict(Plate("B", "steep"))]),
        ("dead_taxels", ["a"]),
        ("stuck_taxels", [10**9]),
        ("circumference_mm", "400"),
        ("circumference_mm", float("nan")),
        ("circumference_mm", 1e300),
        ("steps_per_turn", None),
        ("plate_length_mm", [1]),
    ],
)
def test_a_damaged_record_of_a_world_is_refused(name: str, value: object) -> None:
    header = SimulatedWorld().header_fields()
    header["world"][name] = value
    with pytest.raises(SessionError, match="s: the record of its simulated world is damaged"):
        world_from_header(header, Path("s"))


@pytest.mark.parametrize("world", [None, [], "x", 1])
def test_a_record_that_is_no_world_is_refused(world: object) -> None:
    with pytest.raises(SessionError, match="damaged"):
        world_from_header({"world": world, "world_file": ""}, Path("s"))
