"""Files and folders of results that a rename makes visible: each is complete or absent."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigctl.errors import DiskFault, WrongUse

PARTIAL = "{name}.partial"


@contextmanager
def atomic_directory(out: Path) -> Iterator[Path]:
    """Yield a folder that is renamed to ``out`` at the end, or removed after an error.

    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with _partial_folder(out, "folder") as folder:
        yield folder
        folder.rename(out)


@contextmanager
def new_file(out: Path) -> Iterator[Path]:
    """Yield a path with the name of ``out``, of which a file goes there at the end, or nowhere.

    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with _partial_folder(out, "file") as folder:
        yield folder / out.name
        _refuse_existing(out, "file")
        (folder / out.name).rename(out)


@contextmanager
def _partial_folder(out: Path, kind: str) -> Iterator[Path]:
    """Yield a new folder beside ``out``, and remove what is in it at the end."""
    _refuse_existing(out, kind)
    folder = out.absolute().with_name(PARTIAL.format(name=out.name))
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise WrongUse(
            f"{folder} exists: another process is writing it, or was killed; then remove it"
        ) from None
    except OSError as error:
        raise DiskFault(
            f"{out} cannot be created ({error.strerror}): name another {kind}"
        ) from error
    try:
        yield folder
    except OSError as error:
        raise DiskFault(
            f"{out.name} cannot be written ({error}): free some space or name another {kind}"
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _refuse_existing(out: Path, kind: str) -> None:
    if out.exists():
        raise WrongUse(f"{out} already exists: name another {kind}, or remove it")


@contextmanager
def atomic_file(out: Path) -> Iterator[Path]:
    """Yield a path beside ``out`` that is renamed to it at the end, or removed after an error.

    Raises DiskFault where the file cannot be written.
    """
    partial = out.absolute().with_name(PARTIAL.format(name=out.name))
    try:
        partial.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.replace(out)
    except OSError as error:
        raise DiskFault(
            f"{out} cannot be written ({error}): free some space or name another file"
        ) from error
    finally:
        partial.unlink(missing_ok=True)
