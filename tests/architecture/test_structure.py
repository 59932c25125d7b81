"""Rules of the structure: no import cycles, a sentence for each room, a picture that is true."""

from __future__ import annotations

import re

from tests.architecture import picture
from tests.architecture.imports import CHECKOUT, import_cycles, import_graph, load_modules
from tests.conftest import BEGUN_FIRST


def test_modules_have_no_import_cycle() -> None:
    assert import_cycles(import_graph(load_modules())) == []


def test_an_import_cycle_is_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}
    assert import_cycles(graph) == [["a", "b", "c"]]


def test_the_path_from_a_session_to_table_1_goes_down() -> None:
    page = (CHECKOUT / "docs/explanation/architecture.md").read_text(encoding="utf-8")
    path = [name.replace("/", ".") for name in re.findall(r"^\d+\. `(.*)\.py`", page, re.MULTILINE)]
    graph = import_graph(load_modules())
    assert len(path) > 10
    for place, name in enumerate(path):
        assert not graph[name] & set(path[:place]), f"{name} imports a module above it"


def test_every_room_describes_its_contents_in_one_sentence() -> None:
    silent = [str(m.path) for m in load_modules().values() if m.is_package and not m.summary]
    assert silent == []


def test_the_picture_of_the_rooms_is_up_to_date() -> None:
    assert picture.main(["--check"]) == 0, "run make docs"


def test_the_files_that_are_begun_first_are_there() -> None:
    assert [name for name in BEGUN_FIRST if not (CHECKOUT / "tests" / name).is_file()] == []
