"""Units of the firmware and the includes between them: a unit is a header with its source."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

from tests.architecture.imports import CHECKOUT

FIRMWARE = CHECKOUT / "arduino"
SEARCHED = {"host/drum": ["drum"], "host/taxels": ["taxels"]}
"""Folders that the compiler searches as well, for each folder."""

_INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
_METHOD = re.compile(r"^(?:\w[\w:&*<> ]*[ &*])?([A-Z]\w*)::~?\w+\(", re.MULTILINE)
_CLASS = re.compile(r"^(?:class|struct) (\w+)", re.MULTILINE)


def source_files() -> list[Path]:
    """Return every C and C++ file of the firmware, the host boards and the simulated chips."""
    return sorted(
        path for path in FIRMWARE.rglob("*") if path.suffix in {".c", ".cpp", ".h", ".ino"}
    )


def unit_of(path: Path) -> str:
    """Return the name of a file's unit: its path in ``arduino`` without the suffix."""
    return str(path.relative_to(FIRMWARE).with_suffix("" if path.suffix != ".ino" else ".main"))


def include_graph() -> dict[str, set[str]]:
    """Return the units that each unit includes."""
    graph: dict[str, set[str]] = defaultdict(set)
    for path in source_files():
        unit = unit_of(path)
        included = {unit_of(found) for name in _included(path) if (found := _find(path, name))}
        graph[unit] |= included - {unit}
    return dict(graph)


def _included(path: Path) -> list[str]:
    return _INCLUDE.findall(path.read_text(encoding="utf-8"))


def _find(path: Path, name: str) -> Path | None:
    folder = path.parent.relative_to(FIRMWARE).as_posix()
    places = [path.parent, *(FIRMWARE / other for other in SEARCHED.get(folder, []))]
    return next((p for place in places if (p := (place / name).resolve()).is_file()), None)


def misplaced_methods() -> dict[str, list[str]]:
    """Return, by unit, the classes whose methods it defines and its header does not declare."""
    wrong: dict[str, list[str]] = {}
    for path in source_files():
        header = path.with_suffix(".h")
        declared = set(_CLASS.findall(path.read_text(encoding="utf-8")))
        if header.is_file():
            declared |= set(_CLASS.findall(header.read_text(encoding="utf-8")))
        defined = set(_METHOD.findall(path.read_text(encoding="utf-8")))
        if path.suffix == ".cpp" and defined - declared:
            wrong[unit_of(path)] = sorted(defined - declared)
    return wrong
