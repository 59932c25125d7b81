"""Open models and files of spikes, and identify the sessions that they were made from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from rigctl.config.text_file import open_file, refuse_link_outside
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.session.files.seal import SEALED, check_seal, seal
from rigctl.session.files.source_sessions import read_source_sessions
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.hdf5_file import Hdf5File
from rigctl.session.read.part_file import part_paths

MODEL_LAYOUT, SPIKES_LAYOUT = "rigctl-model", "rigctl-spikes"
FINGER_MODEL_LAYOUT = "rigctl-finger-model"
_KINDS: dict[tuple[str, ...], str] = {
    (MODEL_LAYOUT,): "model",
    (FINGER_MODEL_LAYOUT,): "model of the finger",
}
LAYOUT_VERSION = 1


@contextmanager
def open_analysis_file(path: Path, hint: str, *layouts: str) -> Iterator[Hdf5File]:
    """Open a file of one of ``layouts``, by default a model or a file of spikes.

    Raises SessionError for a missing, damaged, newer or other file, for one that changed since it
    was sealed (:mod:`rigctl.session.files.seal`), and for one with values that
    the ``with`` block finds impossible. ``hint``: which file to give instead.
    """
    kind = _KINDS.get(layouts, "model or a spikes.h5")
    try:
        file = Hdf5File(path)
    except SessionError as error:
        raise SessionError(f"{error}: {hint}") from error
    with file:
        _check_layout(file, kind, hint, layouts or (MODEL_LAYOUT, SPIKES_LAYOUT))
        try:
            yield file
        except SessionError:
            raise
        except WrongUse as error:
            raise SessionError(f"{path} is not a {kind}, or is damaged: {error}") from error
        # Last, because damage to one place is named by that place.
        check_seal(path, bool(file.attributes().get(SEALED)))


def _check_layout(file: Hdf5File, kind: str, hint: str, layouts: tuple[str, ...]) -> None:
    attributes = file.attributes()
    if attributes.get("layout") not in layouts:
        raise SessionError(f"{file.path} is an HDF5 file, but not a {kind}: {hint}")
    version = attributes.get("layout_version")
    if version != LAYOUT_VERSION:
        raise SessionError(
            f"{file.path} has layout version {version}, this program reads {LAYOUT_VERSION}: "
            "use the rigctl that made it, or make it again"
        )


def check_output_path(path: Path) -> None:
    """Raise WrongUse if the file exists or its folder does not."""
    if path.exists():
        raise WrongUse(f"{path} already exists: name another file, or remove it")
    if not path.parent.is_dir():
        raise WrongUse(f"{path.parent} is not a folder: create it, or name another file")


@contextmanager
def new_analysis_file(path: Path) -> Iterator[Any]:
    """Open a new file that appears complete or not at all. Raises WrongUse or DiskFault."""
    check_output_path(path)
    partial = path.with_name(f"{path.name}.partial")
    try:
        with h5py.File(partial, "w", libver=LIBVER) as file:
            file.attrs[SEALED] = 1
            yield file
        seal(partial)
        partial.rename(path)
    except OSError as error:
        raise DiskFault(f"{path} cannot be written ({error}): choose another place") from error
    finally:
        partial.unlink(missing_ok=True)


def content_digest(folder: Path) -> str:
    """Return the SHA-256 of the hexadecimal SHA-256 of each part's bytes, in order.

    The writer never changes a closed part, so equal recordings have equal digests wherever they
    are stored; one that is damaged or lacks a part has another. Raises SessionError for another
    kind of folder or one that it cannot read.
    """
    total = hashlib.sha256()
    for path in part_paths(folder):
        refuse_link_outside(path, SessionError)
        try:
            with open_file(path, SessionError) as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise SessionError(f"{path} cannot be read: {error.strerror or error}") from error
        total.update(digest.encode())
    return total.hexdigest()


def load_inputs(path: Path) -> tuple[dict[str, Any], ...]:
    """Return a mapping for each source session. Raises SessionError for a damaged or other file."""
    with open_analysis_file(path, "give one that rigctl made") as file:
        return read_inputs(file)


def read_inputs(file: Hdf5File) -> tuple[dict[str, Any], ...]:
    """Return the source sessions in an open file. Raises SessionError for missing or wrong ones."""
    return read_source_sessions(file, "training/inputs" if file.has("training") else "inputs")
