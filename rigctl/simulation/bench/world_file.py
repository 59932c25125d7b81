"""A world file: the simulated bench of a lab in TOML, every mistake named at its line.

A file holds what differs from the nominal bench, each parameter under its own name, without
tables; only a plate of the lab's own is one. A mistake raises ConfigError, which names file,
line and key.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import Field, asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from rigctl.config.rig_config import DrumGeometry, RigConfig
from rigctl.config.toml_reader import TomlTable, TomlText
from rigctl.errors import ConfigError, SessionError
from rigctl.simulation.bench import parameter_tables
from rigctl.simulation.bench.parameters import Plate, WorldParameters
from rigctl.simulation.bench.textures import CATALOGUE
from rigctl.values import N_TAXELS

PLATES = "plates"
WORLD, WORLD_FILE = "world", "world_file"
"""Keys of what a session keeps of its world."""


class SimulatedWorld(NamedTuple):
    """A simulated bench, and the name of the file that it came from; empty: the nominal one."""

    parameters: WorldParameters = WorldParameters()
    file: str = ""

    def facts(self) -> dict[str, Any]:
        """What a session keeps of its world: every parameter by name, and the file's name."""
        return {WORLD: asdict(self.parameters), WORLD_FILE: self.file}

    def description(self) -> RigConfig:
        """The description of a rig that has none of its own: it fits drum, plate and load cell."""
        p, nominal = self.parameters, RigConfig()
        shared = {f.name for f in fields(DrumGeometry)} & {f.name for f in fields(p)}
        drum = replace(nominal.drum, **{name: getattr(p, name) for name in shared})
        cell = replace(nominal.loadcell, scale_ug_per_count=round(p.loadcell_ug_per_count))
        return replace(nominal, drum=drum, loadcell=cell)


NOMINAL = SimulatedWorld()
_PLATES_HEAD = (
    "\n# Plates of your own\n"
    "# [plates.B] takes group, height_mm, space_mm, ridge_share; any letter from A to P\n"
)


def load_world(path: Path) -> SimulatedWorld:
    """Read a world file. Raises ConfigError."""
    return SimulatedWorld(_parameters(TomlText.read(path, ConfigError)), path.name)


def parse_world(text: str, name: str = "world.toml") -> WorldParameters:
    """Read a world that is already in memory. Raises ConfigError with ``name``."""
    return _parameters(TomlText(name, text, ConfigError))


def world_toml(parameters: WorldParameters) -> str:
    """Return the whole world as TOML, each parameter with its range, unit and meaning."""
    lines = [_line(parameters, item) for item in fields(parameters) if item.name != PLATES]
    plates = [_plate_toml(plate) for plate in parameters.plates]
    return "".join([*lines, _PLATES_HEAD, *plates]).lstrip()


def recorded_world(simulation: Mapping[str, Any], where: Path) -> SimulatedWorld | None:
    """Return the world that a session's ``simulation`` holds; None where it holds none.

    Raises SessionError where this version knows other parameters.
    """
    if WORLD not in simulation:
        return None
    kept = simulation[WORLD]
    strangers = sorted(kept.keys() ^ {f.name for f in fields(WorldParameters)})
    if strangers:
        raise SessionError(
            f"{where} was recorded in the world of another version of rigctl, {strangers[0]} is "
            "not in both: use the version that began it"
        )
    values: dict[str, Any] = {n: tuple(v) if type(v) is list else v for n, v in kept.items()}
    values[PLATES] = tuple(Plate(**plate) for plate in values[PLATES])
    return SimulatedWorld(WorldParameters(**values), simulation.get(WORLD_FILE, ""))


def _parameters(text: TomlText) -> WorldParameters:
    root = text.root
    _refuse_unknown(root)
    given = {f.name: _value(root, f) for f in fields(WorldParameters) if f.name != PLATES}
    p = WorldParameters(**given)
    p = replace(p, plates=_plates(root.table(PLATES), p))
    end_mm = p.plate_start_mm + p.plate_length_mm
    if end_mm > p.circumference_mm:
        root.fail(
            "plate_length_mm" if "plate_length_mm" in root else "circumference_mm",
            f"the plate would end at {end_mm:g} mm, behind the turn of {p.circumference_mm:g} mm",
        )
    return p


def _value(table: TomlTable, item: Any) -> Any:
    meta, default = item.metadata, item.default
    if not meta:  # numbers of readings
        return table.integers(item.name, default, low=0, high=N_TAXELS - 1)
    return table.number(item.name, default, unit=meta["unit"], low=meta["low"], high=meta["high"])


def _plates(tables: TomlTable, parameters: WorldParameters) -> tuple[Plate, ...]:
    for name in tables:
        if name not in CATALOGUE:
            tables.fail(name, "no such plate: the catalogue has A to P")
    return tuple(_plate(name, tables.table(name), parameters) for name in tables)


def _plate(name: str, table: TomlTable, p: WorldParameters) -> Plate:
    """What is not given is the catalogue's, made with the world's base."""
    kind = CATALOGUE[name]
    nominal = {
        "height_mm": p.base_height_mm * (kind.height or 1.0),
        "space_mm": p.base_space_mm * kind.space,
        "ridge_share": p.ridge_share,
    }
    group = table.choice("group", dict.fromkeys(t.group for t in CATALOGUE.values()), kind.group)
    if group == "smooth" and (shaped := [key for key in table if key in nominal]):
        table.fail(shaped[0], "a smooth plate has none: give it another group")
    sizes = {f.name: f.metadata for f in fields(Plate) if f.metadata}
    values = {
        key: table.number(key, nominal[key], unit=meta["unit"], low=meta["low"], high=meta["high"])
        for key, meta in sizes.items()
    }
    table.finish()
    return Plate(name, group, **values)


def _refuse_unknown(table: TomlTable) -> None:
    units = {f.name: f.metadata.get("unit", "") for f in fields(WorldParameters)}
    for key in table:
        if key not in units:
            table.fail(key, f"no such parameter{_meant(key, units)}")


def _meant(key: str, units: Mapping[str, str]) -> str:
    close = difflib.get_close_matches(key, units, 1)
    if not close:
        return ": `rigctl world` prints them all, each on a line of its own without a table"
    in_unit = f", in {units[close[0]]}" if units[close[0]] else ""
    return f"; did you mean {close[0]!r}{in_unit}?"


def _plate_toml(plate: Plate) -> str:
    head = f'\n[{PLATES}.{plate.name}]\ngroup = "{plate.group}"\n'
    shaped = [f for f in fields(plate) if f.metadata and plate.group != "smooth"]
    return head + "".join(_line(plate, item) for item in shaped)


def _line(values: WorldParameters | Plate, item: Field[Any]) -> str:
    value, meta = getattr(values, item.name), item.metadata
    if not meta:
        return f"{item.name} = {list(value)}  # readings, 0 to {N_TAXELS - 1}\n"
    group = parameter_tables.heading(item.name)
    head = f"\n# {group}\n" if group else ""
    span = f"{meta['low']:.6g} to {meta['high']:.6g} {meta['unit']}".rstrip()
    return f"{head}{item.name} = {repr(value).removesuffix('.0')}  # {span}: {meta['doc']}\n"
