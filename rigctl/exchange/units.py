"""Units of a map's values: speeds to mm/s, forces to g, times to s."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

from rigctl.config.toml_reader import TomlTable

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
RPM, KPA = "rpm", "kPa"
LEVEL, DEPTH = "level", "mm"
"""Units of a force label that is no force: a number without unit, and a depth of pressing."""
MM_PER_S = {
    "mm/s": 1.0,
    "cm/s": 10.0,
    "m/s": 1000.0,
    "mm/min": 1 / 60,
    "m/min": 1000 / 60,
    "inch/s": 25.4,
    "inch/min": 25.4 / 60,
    RPM: 2 * pi / 60,
}
"""Factors to mm/s; that of ``rpm`` for a radius of 1 mm."""
GRAMS = {"g": 1.0, "kg": 1000.0, "N": 101.971621, "mN": 0.101971621, KPA: 0.101971621}
"""Factors to g; that of ``kPa`` for an area of 1 mm²."""
LABEL_GRAMS = {**GRAMS, LEVEL: 1.0, DEPTH: 1.0}
MAX_FACTOR = 1e9


@dataclass(frozen=True, slots=True)
class Conversion:
    """The factor from a value of the files to mm/s or g, and the unit that the map names."""

    factor: float = 1.0
    unit: str = ""


@dataclass(frozen=True, slots=True)
class _Choice:
    """Keys of a table that say a unit: the unit, a length or area for one of them, a factor."""

    unit: str
    size: str
    size_unit: str
    sized: str
    factor: str


def read_speed_unit(labels: TomlTable) -> Conversion:
    """Return the unit of speed labels. Raises ConfigError for ``rpm`` without a radius."""
    keys = _Choice("speed_unit", "radius_mm", "mm", RPM, "speed_factor")
    return _read(labels, keys, MM_PER_S, "mm/s")


def read_force_unit(labels: TomlTable) -> Conversion:
    """Return the unit of force labels. Raises ConfigError for ``kPa`` without an area."""
    keys = _Choice("force_unit", "area_mm2", "mm²", KPA, "force_factor")
    return _read(labels, keys, LABEL_GRAMS, "g")


def read_loadcell_unit(loadcell: TomlTable) -> Conversion:
    """Return the unit of the load cell. Raises ConfigError for ``kPa`` without an area."""
    keys = _Choice("unit", "area_mm2", "mm²", KPA, "factor")
    return _read(loadcell, keys, GRAMS, "g")


def _read(
    table: TomlTable, keys: _Choice, factors: Mapping[str, float], default: str
) -> Conversion:
    """Return the factor of the unit, of its length or area, or the map's own."""
    unit = table.choice(keys.unit, factors, default)
    table.allow(keys.size, keys.factor)
    if keys.factor in table:
        if keys.unit in table or keys.size in table:
            table.fail(keys.factor, f"stands in place of {keys.unit}: give one of them")
        return Conversion(table.number(keys.factor, low=1 / MAX_FACTOR, high=MAX_FACTOR), default)
    if keys.size in table and unit != keys.sized:
        table.fail(keys.size, f"belongs to {keys.unit} = {keys.sized!r}, not to {unit!r}")
    if unit != keys.sized:
        return Conversion(factors[unit], unit)
    if keys.size not in table:
        table.fail(keys.unit, f"{unit} needs {keys.size}, in {keys.size_unit}")
    size = table.number(keys.size, unit=keys.size_unit, low=1e-3, high=1e6)
    return Conversion(factors[unit] * size, unit)
