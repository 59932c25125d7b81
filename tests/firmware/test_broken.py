"""Every edit of a broken firmware fits the sources, and one that does not fails the build."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.config.resources import checkout
from tests.firmware import broken
from tests.firmware.broken import BROKEN, EditFailed, edited_copy

ROOT = checkout()
assert ROOT is not None
ARDUINO = ROOT / "arduino"


@pytest.mark.parametrize(
    ("board", "name"), [(board, name) for board, names in BROKEN.items() for name in names]
)
def test_an_edit_changes_its_board_only(board: str, name: str, tmp_path: Path) -> None:
    copy = edited_copy(ARDUINO, board, name, tmp_path)
    changed = {
        path.relative_to(copy)
        for path in copy.rglob("*")
        if path.is_file() and path.read_bytes() != (ARDUINO / path.relative_to(copy)).read_bytes()
    }
    assert changed == {Path(board) / file for file, *_ in BROKEN[board][name]}


def test_an_edit_whose_text_has_moved_fails_the_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(broken.BROKEN["drum"], "moved", [("zero.cpp", "no such text", "")])
    with pytest.raises(EditFailed, match=r"drum-moved: arduino/drum/zero.cpp holds 0 times"):
        edited_copy(ARDUINO, "drum", "moved", tmp_path)


def test_the_sources_have_no_switches_for_tests() -> None:
    """Conditions choose only the processor, the build hash, the variant and the header's guard."""
    switches = set()
    for path in [*ARDUINO.glob("drum/*"), *ARDUINO.glob("taxels/*")]:
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith(("#if", "#elif")):
                switches.add(line.split("//")[0].split(maxsplit=1)[1].strip())
    guards = {name for name in switches if name.endswith("_H")}
    assert switches - guards == {"__AVR__", "BUILD_HASH", "VARIANT"}
