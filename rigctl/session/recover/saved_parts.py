"""Put back what a recorder saved of a part that was replaced while it was recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.errors import DiskFault, SessionError
from rigctl.session.format.file_names import part_number
from rigctl.session.hdf5_file import Hdf5File
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import open_cut_part, open_part
from rigctl.session.read.recovery_file import MovedFile
from rigctl.session.recover.journal import make_quarantine, quarantine
from rigctl.session.recover.replacement import RECOVERED_FROM
from rigctl.session.recover.survey import part_sha256

SAVED_PATTERN = "part-*.saved"


@dataclass(frozen=True, slots=True)
class SavedPart:
    """A part to put back; ``reason`` continues a sentence that the part's name begins."""

    saved: Path
    path: Path
    reason: str


def find_saved(folder: Path) -> tuple[SavedPart, ...]:
    """Return the saved parts that are better than what is in their place."""
    return tuple(_better(folder))


def put_back(part: SavedPart, place_of: Callable[[Path, str], str]) -> MovedFile | None:
    """Give a saved part its name; return the file that was there, in quarantine now.

    ``place_of``: the place in quarantine for a file and its SHA-256. A kill leaves one of the two
    at the part's name, and both in the folder. Raises DiskFault.
    """
    moved = None
    try:
        if part.path.exists():
            sha256, size = part_sha256(part.path), part.path.stat().st_size
            place = place_of(part.path, sha256)
            make_quarantine(part.path.parent)
            quarantine(part.path, part.path.parent / place, sha256)
            moved = MovedFile(part.path.name, part.reason, sha256, size, place)
        part.saved.replace(part.path)
    except OSError as error:
        raise DiskFault(
            f"{part.saved} cannot be put back: {error.strerror or error}; nothing is lost, run "
            "rigctl recover again"
        ) from error
    return moved


def _better(folder: Path) -> Iterator[SavedPart]:
    for saved in sorted(folder.glob(SAVED_PATTERN)):
        path = saved.with_suffix(".h5")
        found = _description(saved, open_cut_part) if part_number(path) else None
        if found is None or found[0].get("part") != part_number(path):
            continue
        there = _description(path, open_part) if path.exists() else None
        if there is None or there[0] != found[0] or there[1] < found[1]:
            what = "was replaced while it was recorded" if path.exists() else "is missing"
            yield SavedPart(saved, path, f"{what}, {saved.name} has its rows")


def _description(
    path: Path, open_file: Callable[[Path], Hdf5File]
) -> tuple[dict[str, Any], int] | None:
    """Return the attributes and the samples of a part, None if it cannot be read."""
    try:
        part = PartReader(path, open_file)
    except SessionError:
        return None
    part.close()
    attributes = {k: v for k, v in part.attributes.items() if k != RECOVERED_FROM}
    return attributes, part.n_samples
