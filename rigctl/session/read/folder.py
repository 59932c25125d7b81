"""A session's folder before anything is written into it: new, to be resumed, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.errors import DiskFault, SessionError
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import take_text
from rigctl.session.format.header import SessionHeader
from rigctl.session.format.wiring import agree, in_words, wiring_of
from rigctl.session.format.writer_lock import WriterLock, is_being_written
from rigctl.session.read.unclosed_part import UnclosedPart

CACHE_BYTES = 256 << 10
"""Of chunks that HDF5 keeps for each data set: its own 8 MiB add up over a session's parts."""


def part_paths(folder: Path) -> list[Path]:
    """Files of the session's parts, in order; raises SessionError where there is none."""
    parts = sorted(folder.glob(layout.PART_PATTERN))
    if not parts:
        raise SessionError(
            f"{folder} is not a session: it holds no part-0001.h5; give the folder that "
            "rigctl run or rigctl demo made"
        )
    return parts


def part_number(path: Path) -> int:
    """Number in a part's file name; 0 where it is not a part's."""
    digits = path.stem.removeprefix("part-")
    return int(digits) if digits.isdigit() else 0


def open_part(path: Path) -> h5py.File:
    """A part for reading, also while it grows or after its writer was killed.

    Raises SessionError where it is damaged, of another layout version, or none.
    """
    try:
        file = _open(path)
    except OSError as error:
        raise SessionError(f"{path} is damaged, HDF5 cannot open it: {error}") from error
    name, version = (_plain(file.attrs.get(key)) for key in ("layout", "layout_version"))
    if name == layout.LAYOUT and version == layout.LAYOUT_VERSION:
        return file
    file.close()
    if name != layout.LAYOUT:
        raise SessionError(f"{path} is an HDF5 file, but not a part of a rigctl session")
    raise SessionError(
        f"{path} has layout version {version}, this program reads {layout.LAYOUT_VERSION}: "
        "use the rigctl that recorded it"
    )


def _open(path: Path) -> h5py.File:
    """The plain way unless the file says that a writer has it: a living or a dead one."""
    try:
        return h5py.File(path, "r", libver=layout.LIBVER, rdcc_nbytes=CACHE_BYTES)
    except OSError as error:
        if "already open" not in str(error):
            raise
    if _grows(path):
        return h5py.File(path, "r", libver=layout.LIBVER, swmr=True, rdcc_nbytes=CACHE_BYTES)
    return h5py.File(UnclosedPart(path), "r", rdcc_nbytes=CACHE_BYTES)


def _grows(path: Path) -> bool:
    """Whether a living writer appends to this part: then it is the session's last."""
    last = max(path.parent.glob(layout.PART_PATTERN))
    return path.name == last.name and is_being_written(path.parent)


def attributes(node: Any) -> dict[str, Any]:
    """Attributes of a file, group or data set as Python's own values."""
    return {name: _plain(value) for name, value in node.attrs.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode().rstrip("\0")
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def prepare(folder: Path, header: SessionHeader, resume: bool) -> WriterLock:
    """Make the folder and lock it.

    Raises SessionError where it holds a session (without ``resume``), another plan's session,
    one of another order of taxels or none (with ``resume``), or has a living writer; DiskFault
    where it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise SessionError(f"{folder} is a file: a session needs a folder of its own") from error
    except OSError as error:
        raise DiskFault(f"cannot make {folder}: {error.strerror}; choose another folder") from error
    lock = WriterLock(folder)
    try:
        _check_contents(folder, header, resume)
    except BaseException:
        lock.release()
        raise
    return lock


def write_text(path: Path, text: str) -> None:
    """Write a text beside the parts once; a later sitting keeps the first one's."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        return
    except OSError as error:
        raise DiskFault(
            f"cannot write {path}: {error.strerror}; make room or choose another disk"
        ) from error


def _check_contents(folder: Path, header: SessionHeader, resume: bool) -> None:
    parts = sorted(folder.glob(layout.PART_PATTERN))
    if parts and not resume:
        raise SessionError(
            f"{folder} already holds a session: continue it with --resume, or choose another folder"
        )
    if not parts and resume:
        part_paths(folder)
    if parts:
        _check_plan(parts[-1], header)


def _check_plan(path: Path, header: SessionHeader) -> None:
    with open_part(path) as file:
        recorded = SessionHeader.from_attributes(attributes(file))
        wiring = wiring_of(recorded, take_text(file, "/rig_toml"))
    if (recorded.plan_hash, recorded.n_taxels) != (header.plan_hash, header.n_taxels):
        raise SessionError(
            f"{path.parent} was recorded with another protocol or seed: resume it with its own "
            f"{layout.PROTOCOL_FILE}, or start a new session"
        )
    if not agree(header.wiring, wiring):
        raise SessionError(
            f"{path.parent} has its taxels in another order than this rig has "
            f"({in_words(wiring, header.wiring)}): go on with the wiring that it was begun with, "
            "or start a new session"
        )
