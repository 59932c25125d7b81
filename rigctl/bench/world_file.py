"""Read and write world files: the parameters of a simulated bench in TOML.

A file lists the parameters that differ from the nominal bench, by name and without tables, except
for the lab's own plates. A mistake raises ConfigError, which names file, line and key.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Mapping
from dataclasses import Field, asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from rigctl.bench import parameter_tables
from rigctl.bench.parameters import Plate, WorldParameters, validated
from rigctl.bench.textures import CATALOGUE, Texture
from rigctl.config.rig_config import MAX_TAXELS, DrumGeometry, RigConfig
from rigctl.config.text_file import name_problem
from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.errors import ConfigError, SessionError, WrongUse
from rigctl.protocol.fields import TEXTURE_BYTES

PLATES = "plates"
WORLD, WORLD_FILE = "world", "world_file"
"""Keys of the world in a session's header."""


class SimulatedWorld(NamedTuple):
    """Parameters of a simulated bench and the name of their file; empty for the nominal bench."""

    parameters: WorldParameters = WorldParameters()
    file: str = ""

    def header_fields(self) -> dict[str, Any]:
        """Return the entries of a session's header: every parameter, and the file's name."""
        return {WORLD: asdict(self.parameters), WORLD_FILE: self.file}

    def rig_config(self) -> RigConfig:
        """Return a rig description that fits the world's drum, plate and load cell.

        The clamp of a simulated bench carries the sensor as its plates do.
        """
        p, nominal = self.parameters, RigConfig()
        shared = {f.name for f in fields(DrumGeometry)} & {f.name for f in fields(p)}
        geometry = {name: getattr(p, name) for name in shared}
        drum = replace(nominal.drum, **geometry, level_joint=True)
        loadcell = replace(nominal.loadcell, scale_ug_per_count=round(p.loadcell_ug_per_count))
        return replace(nominal, drum=drum, loadcell=loadcell)


NOMINAL_WORLD = SimulatedWorld()
_GROUPS = tuple(dict.fromkeys(texture.group for texture in CATALOGUE.values()))
_PLATES_HEAD = (
    "\n# Plates of your own\n"
    "# [plates.B] takes group, height_mm, space_mm, ridge_share; A to P are the catalogue's\n"
)


def load_world(path: Path) -> SimulatedWorld:
    """Read a world file. Raises ConfigError."""
    return SimulatedWorld(parse_world(TomlText.read(path, ConfigError)), path.name)


def parse_world(text: TomlText) -> WorldParameters:
    """Parse a world file. Raises ConfigError."""
    root = text.root
    _reject_unknown(root)
    values = {f.name: _value(root, f) for f in fields(WorldParameters) if f.name != PLATES}
    p = WorldParameters(**values)
    p = replace(p, plates=_plates(root.table(PLATES), p))
    end_mm = p.plate_start_mm + p.plate_length_mm
    if end_mm > p.circumference_mm:
        root.fail(
            "plate_length_mm" if "plate_length_mm" in root else "circumference_mm",
            f"the plate would end at {end_mm:g} mm, beyond the turn of {p.circumference_mm:g} mm",
        )
    return p


def format_world(parameters: WorldParameters) -> str:
    """Return the whole world as TOML, each parameter with its range, unit and meaning."""
    lines = [_line(parameters, item) for item in fields(parameters) if item.name != PLATES]
    plates = [_plate_toml(plate) for plate in parameters.plates]
    return "".join([*lines, _PLATES_HEAD, *plates]).lstrip()


def world_from_header(simulation: Mapping[str, Any], where: Path) -> SimulatedWorld | None:
    """Return the world in a session header's ``simulation``; None if there is none.

    Raises SessionError if this version has other parameters.
    """
    if WORLD not in simulation:
        return None
    recorded, file = simulation[WORLD], simulation.get(WORLD_FILE, "")
    if not isinstance(recorded, dict) or not isinstance(file, str):
        raise SessionError(f"{where}: the record of its simulated world is damaged")
    differing = sorted(recorded.keys() ^ {f.name for f in fields(WorldParameters)})
    if differing:
        raise SessionError(
            f"{where} was recorded in the world of another version of rigctl: only one of the two "
            f"has {differing[0]}; use the version that recorded it"
        )
    try:
        parameters = validated(msgspec.convert(recorded, type=WorldParameters))
    except (msgspec.ValidationError, WrongUse) as error:
        raise SessionError(
            f"{where}: the record of its simulated world is damaged: {error}"
        ) from error
    for plate in parameters.plates:
        if name_problem(plate.name, TEXTURE_BYTES) or plate.group not in _GROUPS:
            raise SessionError(
                f"{where}: the record of its simulated world is damaged: there is no plate "
                f"{plate.name!r} of the group {plate.group!r}"
            )
    return SimulatedWorld(parameters, file)


def _value(table: TomlTable, item: Any) -> Any:
    meta, default = item.metadata, item.default
    if not meta:  # reading numbers
        return table.integers(item.name, default, low=0, high=MAX_TAXELS - 1)
    return table.number(item.name, default, unit=meta["unit"], low=meta["low"], high=meta["high"])


def _plates(tables: TomlTable, parameters: WorldParameters) -> tuple[Plate, ...]:
    for name in tables:
        if problem := name_problem(name, TEXTURE_BYTES):
            tables.fail(name, f"the plate's name {problem}")
    return tuple(_plate(name, tables.table(name), parameters) for name in tables)


def _plate(name: str, table: TomlTable, p: WorldParameters) -> Plate:
    """Return a plate; missing values come from the catalogue and the world's base plate.

    A plate that the catalogue does not have must name its group.
    """
    default = CATALOGUE.get(name, Texture(name, "", 1.0, 1.0))
    nominal = {
        "height_mm": p.base_height_mm * (default.height or 1.0),
        "space_mm": p.base_space_mm * default.space,
        "ridge_share": p.ridge_share,
    }
    group = table.choice("group", _GROUPS, default.group or None)
    if group == "smooth" and (shaped := [key for key in table if key in nominal]):
        table.fail(shaped[0], "a smooth plate has none: give it another group")
    sizes = {f.name: f.metadata for f in fields(Plate) if f.metadata}
    values = {
        key: table.number(key, nominal[key], unit=meta["unit"], low=meta["low"], high=meta["high"])
        for key, meta in sizes.items()
    }
    table.finish()
    return Plate(name, group, **values)


def _reject_unknown(table: TomlTable) -> None:
    units = {f.name: f.metadata.get("unit", "") for f in fields(WorldParameters)}
    for key in table:
        if key not in units:
            table.fail(key, f"no such parameter{_suggestion(key, units)}")


def _suggestion(key: str, units: Mapping[str, str]) -> str:
    close = difflib.get_close_matches(key, units, 1)
    if not close:
        return ": `rigctl world` prints them all, each on a line of its own without a table"
    in_unit = f", in {units[close[0]]}" if units[close[0]] else ""
    return f"; did you mean {close[0]!r}{in_unit}?"


def _plate_toml(plate: Plate) -> str:
    is_bare = re.fullmatch(r"[A-Za-z0-9_-]+", plate.name)
    key = plate.name if is_bare else json.dumps(plate.name, ensure_ascii=False)
    head = f'\n[{PLATES}.{key}]\ngroup = "{plate.group}"\n'
    shaped = [f for f in fields(plate) if f.metadata and plate.group != "smooth"]
    return head + "".join(_line(plate, item) for item in shaped)


def _line(values: WorldParameters | Plate, item: Field[Any]) -> str:
    value, meta = getattr(values, item.name), item.metadata
    if not meta:
        return f"{item.name} = {list(value)}  # readings of the board, from 0\n"
    group = parameter_tables.heading(item.name)
    head = f"\n# {group}\n" if group else ""
    span = f"{meta['low']:.6g} to {meta['high']:.6g} {meta['unit']}".rstrip()
    return f"{head}{item.name} = {repr(value).removesuffix('.0')}  # {span}: {meta['doc']}\n"
