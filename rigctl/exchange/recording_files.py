"""The files of an import: those that are named, and all recordings in folders that are named."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from rigctl.errors import WrongUse

TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".lvm")
SUFFIXES = (*TEXT_SUFFIXES, ".mat", ".npy", ".npz", ".nwb")
MOST_FILES = 1_000_000


class FoundRecordings(NamedTuple):
    """The files of an import, and those of its folders that are of another kind."""

    files: list[Path]
    left_out: list[Path]


def find_recordings(paths: Iterable[Path]) -> FoundRecordings:
    """Return the files, and in place of a folder the recordings below it in order of their names.

    Recordings in a folder are its files with the commonest suffix, hidden ones left out. Raises
    WrongUse for a folder without any, and for more than a million files.
    """
    found = FoundRecordings([], [])
    for path in paths:
        files = _in_folder(path) if path.is_dir() else [path]
        if not files:
            raise WrongUse(
                f"{path} has no recordings: their names end in {', '.join(SUFFIXES)}; save a "
                "workbook as CSV, unpack an archive"
            )
        kind = Counter(file.suffix.lower() for file in files).most_common(1)[0][0]
        for file in files:
            (found.files if file.suffix.lower() == kind else found.left_out).append(file)
        if len(found.files) > MOST_FILES:
            raise WrongUse(f"more than {MOST_FILES:,} files: import fewer at a time")
    return found


def refuse_unreadable_names(paths: Iterable[Path]) -> None:
    """Raise WrongUse for a path that is no text: neither a map nor a session could name it."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError as error:
            shown = str(path).encode(errors="replace").decode()
            raise WrongUse(f"{shown}: its name is not in UTF-8: rename it") from error


def common_folder(paths: Sequence[Path]) -> Path:
    """Return the innermost folder that contains every path, absolute."""
    return Path(os.path.commonpath([path.absolute().parent for path in paths]))


def _in_folder(folder: Path) -> list[Path]:
    return sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in SUFFIXES
        and not any(part.startswith((".", "~$")) for part in path.relative_to(folder).parts)
        and path.is_file()
    )
