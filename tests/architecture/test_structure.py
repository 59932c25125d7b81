"""Rules of the structure: small files and folders, no import cycles, unique class names."""

from __future__ import annotations

from collections import Counter, defaultdict
from statistics import median

from tests.architecture import picture
from tests.architecture.imports import CHECKOUT, import_cycles, import_graph, load_modules

MOST_MODULES = 14
MOST_LINES = 400
MEDIAN_LINES = 150
MODULES = load_modules()


def test_modules_have_no_import_cycle() -> None:
    assert import_cycles(import_graph(MODULES)) == []


def test_an_import_cycle_is_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}
    assert import_cycles(graph) == [["a", "b", "c"]]


def test_no_folder_holds_more_than_fourteen_modules() -> None:
    sizes = Counter(str(m.path.parent) for m in MODULES.values() if not m.is_package)
    assert {folder: n for folder, n in sizes.items() if n > MOST_MODULES} == {}


def test_files_are_short() -> None:
    long = {str(m.path): m.lines for m in MODULES.values() if m.lines > MOST_LINES}
    assert long == {}
    assert median(m.lines for m in MODULES.values() if not m.is_package) < MEDIAN_LINES


def test_files_of_tests_are_short() -> None:
    lines = {
        str(path.relative_to(CHECKOUT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in (CHECKOUT / "tests").rglob("*.py")
    }
    assert {path: n for path, n in lines.items() if n > MOST_LINES} == {}


def test_no_class_name_is_used_twice() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for module in MODULES.values():
        for name in module.class_names():
            places[name].append(module.name)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_every_room_describes_its_contents_in_one_sentence() -> None:
    silent = [str(m.path) for m in MODULES.values() if m.is_package and not m.summary]
    assert silent == []


def test_the_picture_of_the_rooms_is_up_to_date() -> None:
    assert picture.main(["--check"]) == 0, "run make docs"
