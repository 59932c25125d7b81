"""Move originals to quarantine and replacements into place, so that a kill at any moment is safe.

The journal is the recovery file under a temporary name, written before anything moves. Every step
can be done again: an original gets its second name in quarantine before the first one is taken
away, and a replacement is whole before it gets the part's name. Whoever finds a journal finishes
it; then it gets its own name.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from rigctl.errors import DiskFault, SessionError
from rigctl.session.read.recovery_file import (
    PENDING_PATTERN,
    QUARANTINE,
    RecoveryRecord,
    read_recovery,
)
from rigctl.session.recover.survey import part_sha256
from rigctl.session.write.part_writer import sync_folder

REPLACEMENT = ".recovered"
"""Ending of a new part until it takes its place."""


def write_journal(path: Path, text: str) -> Path:
    """Write the text of a recovery file under its temporary name. Raises DiskFault."""
    pending = path.with_name(f"{path.name}.new")
    try:
        with pending.open("x", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            pending.unlink()
        raise DiskFault(
            f"cannot write {pending}: {error.strerror}; make room or choose another disk, the "
            "originals are unchanged"
        ) from error
    return pending


def finish_pending(folder: Path) -> list[RecoveryRecord]:
    """Finish interrupted recoveries; remove what one left that had not begun to move anything."""
    finished = []
    for pending in sorted(folder.glob(PENDING_PATTERN)):
        try:
            read_recovery(pending)
        except SessionError:  # torn: nothing moves before the whole journal is on the medium
            pending.unlink()
            continue
        finished.append(carry_out(pending))
    for path in folder.glob(f"part-*{REPLACEMENT}"):
        path.unlink()
    return finished


def carry_out(pending: Path) -> RecoveryRecord:
    """Do every step of a journal that is not done yet, and give it its own name.

    Raises SessionError where a file is not the one that the journal means, DiskFault where the
    disk refuses a step: run it again then.
    """
    folder, record = pending.parent, read_recovery(pending)
    try:
        if any(part.quarantined_as for part in record.parts) or record.moved:
            make_quarantine(folder)
        for part in record.parts:
            if part.quarantined_as:
                quarantine(folder / part.name, folder / part.quarantined_as, part.sha256)
                _replace(folder / part.name, part.sha256, part.replaced_by)
        for moved in record.moved:
            quarantine(folder / moved.name, folder / moved.quarantined_as, moved.sha256)
            _replace(folder / moved.name, moved.sha256, "")
        final = pending.with_suffix("")
        pending.rename(final)
        sync_folder(folder)
    except OSError as error:
        raise DiskFault(
            f"{folder} cannot be put in order: {error.strerror or error}; nothing is lost, run "
            "rigctl recover again"
        ) from error
    return read_recovery(final)


def make_quarantine(folder: Path) -> None:
    """Make the folder of the originals. Raises SessionError for a link or another file."""
    path = folder / QUARANTINE
    path.mkdir(exist_ok=True)
    if path.is_symlink() or not path.is_dir():
        raise SessionError(f"{path} is not a folder: move it elsewhere")


def quarantine(original: Path, place: Path, sha256: str) -> None:
    """Give an original its name in quarantine; the other one stays until :func:`_replace`."""
    if place.is_symlink() or place.exists():
        if part_sha256(place) != sha256:
            raise SessionError(f"{place} is another file than {original.name}: move it elsewhere")
        return
    if part_sha256(original) != sha256:
        raise SessionError(
            f"{original} changed while it was put in order: run rigctl recover again"
        )
    try:
        os.link(original, place)
    except OSError:  # a file system without hard links
        original.rename(place)
    sync_folder(place.parent)
    sync_folder(original.parent)


def _replace(path: Path, original_sha256: str, new_sha256: str) -> None:
    """Put the replacement, if there is one, in the place of an original that is in quarantine."""
    new = path.with_name(path.name + REPLACEMENT)
    if new_sha256 and new.exists():
        if part_sha256(new) != new_sha256:
            raise SessionError(f"{new} is not the part that was recovered: remove it")
        new.replace(path)
    elif not new_sha256 and path.exists() and part_sha256(path) == original_sha256:
        path.unlink()
    sync_folder(path.parent)
