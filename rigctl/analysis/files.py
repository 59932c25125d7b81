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
    if out.exists():
        raise WrongUse(f"{out} already exists: name another folder, or remove it")
    folder = out.absolute().with_name(PARTIAL.format(name=out.name))
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise WrongUse(
            f"{folder} exists: another analysis is writing it, or was killed; then remove it"
        ) from None
    except OSError as error:
        raise DiskFault(
            f"{out} cannot be created ({error.strerror}): name another folder"
        ) from error
    try:
        yield folder
        folder.rename(out)
    except OSError as error:
        raise DiskFault(
            f"{out.name} cannot be written ({error}): free some space or name another folder"
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


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
