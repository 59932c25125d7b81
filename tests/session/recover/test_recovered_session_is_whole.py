"""Damage that leaves every part readable: a recovered session is whole and names what it lost."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.session.recover.recover import recover
from rigctl.session.verify.session import verify
from tests.session import building

NOW = "2026-11-23T12:00:00Z"
Spoil = Callable[[Path], object]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "s"
    building.record_plan(folder)
    return folder


def cut_line(folder: Path) -> None:
    lines = folder / "digests.txt"
    lines.write_bytes(lines.read_bytes()[:-20])


def change_line(folder: Path) -> None:
    lines = folder / "digests.txt"
    lines.write_bytes(lines.read_bytes().replace(b" closed part-0001.h5", b" closed part-0002.h5"))


def repeat_lines(folder: Path) -> None:
    lines = folder / "digests.txt"
    lines.write_bytes(lines.read_bytes() * 2000)


def write(name: str, text: str) -> Spoil:
    return lambda folder: (folder / name).write_text(text)


def change_row(table: str) -> Spoil:
    def spoil(folder: Path) -> None:
        with h5py.File(folder / "part-0001.h5", "r+") as file:
            row = len(file[table]) // 2
            stored = file[table][row : row + 1]
            data = stored.view(np.uint8).reshape(-1)
            data[min(3, len(data) - 1)] ^= 1
            file[table][row : row + 1] = stored

    return spoil


def resize(table: str, by: int) -> Spoil:
    def spoil(folder: Path) -> None:
        with h5py.File(folder / "part-0001.h5", "r+") as file:
            file[table].resize(max(0, len(file[table]) + by), axis=0)

    return spoil


DAMAGE: dict[str, tuple[Spoil, int]] = {
    "digests.txt is gone": (lambda folder: (folder / "digests.txt").unlink(), 8),
    "a line is cut": (cut_line, 8),
    "a line has another part": (change_line, 8),
    "every line is there 2,000 times": (repeat_lines, 8),
    "another rig.toml": (write("rig.toml", "[about]\nname = 'other'\n"), 8),
    "another protocol.toml": (write("protocol.toml", ""), 8),
    "a trial's row is changed": (change_row("/trials"), 4),
    "a load-cell row is changed": (change_row("/loadcell"), 4),
    "an arrival is changed": (change_row("/taxels/arrivals"), 4),
    "samples are removed": (resize("/taxels/samples", -2), 4),
    "a poll is removed": (resize("/drum", -1), 4),
    "a poll is added": (resize("/drum", 1), 8),
    "a trial is added": (resize("/trials", 1), 8),
    "digests are removed": (resize("/digests", -2), 4),
    "a digest is added": (resize("/digests", 1), 8),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_recovered_session_is_whole(recorded: Path, tmp_path: Path, what: str) -> None:
    spoil, kept = DAMAGE[what]
    folder = Path(shutil.copytree(recorded, tmp_path / "s"))
    spoil(folder)
    assert not verify(folder).whole
    record = recover(folder, NOW).record
    assert record is not None
    report = verify(folder)
    assert report.problems == []
    assert report.trials_committed >= kept
    assert any(
        word in note for note in report.notes for word in ("recovery file", "anew", "is missing")
    )
    assert recover(folder, NOW).record is None


@pytest.mark.parametrize("what", ["a poll is added", "samples are removed"])
def test_later_damage_of_a_recovered_session_is_noticed(
    recorded: Path, tmp_path: Path, what: str
) -> None:
    folder = Path(shutil.copytree(recorded, tmp_path / "s"))
    DAMAGE[what][0](folder)
    recover(folder, NOW)
    change_row("/taxels/flags")(folder)
    assert any("/taxels/flags" in line for line in verify(folder).problems)


@pytest.mark.parametrize("what", ["a line has another part", "a trial's row is changed"])
def test_a_kept_digest_does_not_take_a_recovery_files_word(
    recorded: Path, tmp_path: Path, what: str
) -> None:
    folder = Path(shutil.copytree(recorded, tmp_path / "s"))
    digest = verify(folder).closing_digest
    DAMAGE[what][0](folder)
    recover(folder, NOW)
    assert verify(folder, digest=digest).whole == (what == "a line has another part")
