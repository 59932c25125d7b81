"""Check the attributes of a part and parse them into the values of its header."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.config.rig_config import MAX_TAXELS
from rigctl.encoding.reading import Reading
from rigctl.errors import SessionError
from rigctl.session.format.metadata.sensor_layout import ATTRIBUTE, SensorLayout
from rigctl.session.hdf5_file import parse_json, parse_objects
from rigctl.values import BoardIdentity

TEXTS = (
    "plan_hash", "rig", "start_utc", "protocol", "operator", "sensor", "software_version",
    "software_commit", "encoder_preset", "encoder_reading", "sample_unit", "cut_by", "experiment",
)  # fmt: skip
INT64 = 1 << 63
COUNT = 1 << 31
INTEGERS = {
    "seed": (-INT64, 2 * INT64),
    "trials_planned": (0, COUNT),
    "simulated": (0, 1),
    "n_taxels": (1, MAX_TAXELS),
    "sample_rate_hz": (1, 1_000_000),
    "highest_reading": (1, 65_535),
    "reference_um_per_s": (0, COUNT),
}
"""Lowest and highest value of each integer."""
PER_TAXEL = {"taxel_low": 65_535, "taxel_high": 65_535, "wiring": MAX_TAXELS - 1}
"""Highest value of the lists with one integer for each taxel; these may also be empty."""
MAPPINGS = ("simulation", "tracker")
REQUIRED = ("plan_hash", "seed", "trials_planned", "rig", "simulated", "start_utc", "boards")
_BOARD = {
    "board": str, "firmware_version": str, "build_hash": str, "wire_version": int,
    "boot_count": int, "reset_cause": int, "details": dict,
}  # fmt: skip


def parse_header_values(attributes: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return the header's values by name, without those that an older part lacks.

    Raises SessionError that names the attribute for a missing one, another type, or a value out of
    its range. Unknown attributes are ignored.
    """
    for name in REQUIRED:
        if name not in attributes:
            raise SessionError(f"{path} is damaged: it lacks the attribute {name}")
    values: dict[str, Any] = {}
    for name in (*TEXTS, *INTEGERS, "start_loop_s"):
        if name in attributes:
            _check_plain(name, attributes[name], path)
            values[name] = attributes[name]
    n_taxels = values.get("n_taxels")
    for name in ("boards", "stages", *PER_TAXEL, *MAPPINGS):
        if name in attributes:
            values[name] = _parse(name, attributes[name], n_taxels, path)
    if ATTRIBUTE in attributes:
        values[ATTRIBUTE] = SensorLayout.from_attributes(attributes, path)
    return values


def _check_plain(name: str, value: Any, path: Path) -> None:
    if name in TEXTS:
        if not isinstance(value, str):
            raise _wrong(path, name, value, "a text")
        if name == "encoder_reading" and value not in list(Reading):
            raise _wrong(path, name, value, f"one of {', '.join(Reading)}")
    elif name in INTEGERS:
        low, high = INTEGERS[name]
        if not isinstance(value, int) or not low <= value <= high:
            raise _wrong(path, name, value, f"an integer from {low} to {high}")
    elif not isinstance(value, float | int) or not math.isfinite(value):
        raise _wrong(path, name, value, "a finite number")


def _parse(name: str, value: Any, n_taxels: int | None, path: Path) -> Any:
    place = f"attribute {name} of the file"
    if not isinstance(value, str):
        raise _wrong(path, name, value, "a JSON text")
    if name in MAPPINGS:
        return parse_json(value, dict, path, place)
    if name == "boards":
        return tuple(_board(item, path) for item in parse_objects(value, path, place))
    items = parse_json(value, list, path, place)
    if name == "stages":
        if not all(isinstance(item, str) for item in items):
            raise _wrong(path, name, value, "a list of texts")
    elif not _is_per_taxel(items, PER_TAXEL[name], n_taxels):
        raise _wrong(path, name, value, "empty or one integer for each taxel")
    return tuple(items)


def _is_per_taxel(items: list[Any], highest: int, n_taxels: int | None) -> bool:
    return len(items) in (0, n_taxels or len(items)) and all(
        type(item) is int and 0 <= item <= highest for item in items
    )


def _board(item: Mapping[str, Any], path: Path) -> BoardIdentity:
    """Return a board from its JSON object; older ones lack ``details``."""
    wanted = {name: kind for name, kind in _BOARD.items() if name != "details" or name in item}
    if item.keys() != wanted.keys() or not all(
        isinstance(item[name], kind) for name, kind in wanted.items()
    ):
        raise _wrong(path, "boards", dict(item), "a list of boards with their identities")
    return BoardIdentity(**item)


def _wrong(path: Path, name: str, value: Any, wanted: str) -> SessionError:
    shown = repr(value)
    shown = shown if len(shown) <= 60 else f"{shown[:60]}…"
    return SessionError(f"{path} is damaged: its attribute {name} is {shown}, not {wanted}")
