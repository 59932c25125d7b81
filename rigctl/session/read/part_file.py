"""Find and open the files of a session's parts for reading."""

from __future__ import annotations

from pathlib import Path

from rigctl.config.text_file import refuse_link_outside
from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.format.digests import describe_part
from rigctl.session.format.file_names import PART_PATTERN, part_number
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.hdf5_file import Hdf5File, UnclosedFile, hdf5_errors
from rigctl.session.read.unclosed_part import map_as_closed

CACHE_BYTES = 256 << 10
"""HDF5's chunk cache for each data set: its default of 8 MiB adds up over a session's parts."""


def part_paths(folder: Path) -> list[Path]:
    """Return the files of the session's parts, in order. Raises SessionError if there are none."""
    parts = existing_parts(folder)
    if not parts:
        raise no_session(folder)
    return parts


def no_session(folder: Path) -> SessionError:
    """Return the error for a folder that holds no part of a session."""
    lack = "it contains no part-0001.h5" if folder.is_dir() else "there is no such folder"
    return SessionError(
        f"{folder} is not a session: {lack}; give the folder that rigctl run or rigctl demo made"
    )


def existing_parts(folder: Path) -> list[Path]:
    """Return the files that have the name of a part, in order."""
    paths = [path for path in folder.glob(PART_PATTERN) if part_number(path)]
    return sorted(paths, key=part_number)


def stray_files(folder: Path) -> list[str]:
    """Return the names of files that look like parts and are none, such as copies."""
    names = (path.name for path in folder.glob(PART_PATTERN) if not part_number(path))
    return sorted(names)


def open_part(path: Path) -> Hdf5File:
    """Open a part for reading, also while it grows or after its writer was killed.

    Raises SessionError for a damaged part, another layout version or another kind of file.
    """
    return _checked(open_appended(path, _is_growing(path)))


def open_cut_part(path: Path) -> Hdf5File:
    """Open a part of which the end may be missing, also a closed one; nobody may write it.

    Raises SessionError as :func:`open_part` does.
    """
    refuse_link_outside(path, SessionError)
    return _checked(_map(path))


def _checked(file: Hdf5File) -> Hdf5File:
    try:
        _check_layout(file)
    except SessionError:
        file.close()
        raise
    return file


def _check_layout(file: Hdf5File) -> None:
    attributes = file.attributes()
    name, version = attributes.get("layout"), attributes.get("layout_version")
    if name != layout.LAYOUT:
        raise SessionError(f"{file.path} is an HDF5 file, but not a part of a rigctl session")
    if version != layout.LAYOUT_VERSION:
        raise SessionError(
            f"{file.path} has layout version {version}, this program reads "
            f"{layout.LAYOUT_VERSION}: use the rigctl that recorded it"
        )


def describe_file(file: Hdf5File) -> bytes:
    """Return what a file holds besides its rows, as its first digest covers it."""
    with hdf5_errors(file.path, "its description"):
        return describe_part(file.h5py_file)


def open_appended(path: Path, is_growing: bool) -> Hdf5File:
    """Open a file that is only ever appended to: closed, growing, or left by a killed writer.

    ``is_growing``: a living writer may have it open. Raises SessionError for a damaged file, and
    for a link that leads out of the session.
    """
    refuse_link_outside(path, SessionError)
    # A closed file opens directly, a growing one in SWMR mode and an unclosed one through a map.
    try:
        return Hdf5File(path, libver=LIBVER, rdcc_nbytes=CACHE_BYTES)
    except UnclosedFile:
        if is_growing:
            return Hdf5File(path, swmr=True, libver=LIBVER, rdcc_nbytes=CACHE_BYTES)
    return _map(path)


def _map(path: Path) -> Hdf5File:
    try:
        image = map_as_closed(path)
    except OSError as error:
        raise SessionError(f"{path} is damaged, HDF5 cannot open it: {error}") from error
    return Hdf5File(path, image=image, rdcc_nbytes=CACHE_BYTES)


def _is_growing(path: Path) -> bool:
    """Return whether a living writer appends to this part, which is then the session's last."""
    last = existing_parts(path.parent)[-1:]
    return [path.name] == [part.name for part in last] and is_being_written(path.parent)


def readable_rows(file: Hdf5File, path: str) -> int:
    """Return how many rows of a data set the file of an unclosed part holds, from the first on.

    A closed part that was cut short does not open at all; in one whose writer was killed, the last
    chunks may be beyond the end. Raises SessionError for chunks that HDF5 cannot find.
    """
    n_rows, chunk = file.shape(path)[0], file.chunk_shape(path)
    addresses = file.chunk_addresses(path)
    if not chunk or addresses is None:
        return n_rows
    present = set((addresses[0] // chunk[0]).tolist())
    absent = next(n for n in range(len(present) + 1) if n not in present)
    return min(n_rows, absent * chunk[0])
