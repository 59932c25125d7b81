"""The firmware's files include each other downwards only, and each class is in one unit."""

from __future__ import annotations

from tests.architecture import includes
from tests.architecture.imports import import_cycles

MOST_LINES = 450


def test_the_firmware_has_no_include_cycle() -> None:
    graph = includes.include_graph()
    assert import_cycles(graph) == []
    assert graph["drum/commands"] >= {"drum/bank", "drum/controller"}
    assert graph["host/drum/drum_board"] >= {"drum/drum", "host/serial_line"}


def test_a_class_is_defined_in_the_source_of_its_own_header() -> None:
    assert includes.misplaced_methods() == {}


def test_the_files_of_the_firmware_are_short() -> None:
    lines = {
        includes.unit_of(path): len(path.read_text(encoding="utf-8").splitlines())
        for path in includes.source_files()
    }
    assert {unit: count for unit, count in lines.items() if count > MOST_LINES} == {}
