"""The firmware's files include each other downwards only, and each class is in one unit."""

from __future__ import annotations

from tests.architecture import includes
from tests.architecture.imports import import_cycles


def test_the_firmware_has_no_include_cycle() -> None:
    graph = includes.include_graph()
    assert import_cycles(graph) == []
    assert graph["drum/commands"] >= {"drum/bank", "drum/controller"}
    assert graph["host/drum/drum_board"] >= {"drum/drum", "host/serial_line"}


def test_a_class_is_defined_in_the_source_of_its_own_header() -> None:
    assert includes.misplaced_methods() == {}
