"""A file that a rename makes visible: it is complete or absent."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigctl.analysis.data.atomic_directory import PARTIAL
from rigctl.errors import DiskFault


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
