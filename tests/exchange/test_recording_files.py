"""Which files of a folder are the recordings of an import."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import WrongUse
from rigctl.exchange.recording_files import find_recordings
from tests.exchange.layouts import write_rows


def test_a_folder_stands_for_its_recordings_of_the_commonest_kind(tmp_path: Path) -> None:
    kept = [write_rows(tmp_path / "b" / f"{k}.csv", "", [[1]]) for k in range(2)]
    other = write_rows(tmp_path / "notes.txt", "", [[1]])
    assert find_recordings([tmp_path]) == (kept, [other])


def test_hidden_files_and_folders_are_no_recordings(tmp_path: Path) -> None:
    kept = write_rows(tmp_path / "1.csv", "", [[1]])
    write_rows(tmp_path / "._1.csv", "", [[1]])
    write_rows(tmp_path / ".ipynb_checkpoints" / "1-checkpoint.csv", "", [[1]])
    (tmp_path / "old.csv").mkdir()
    assert find_recordings([tmp_path]) == ([kept], [])


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WrongUse, match="has no recordings"):
        find_recordings([tmp_path])
