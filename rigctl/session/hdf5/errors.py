"""Turn what HDF5 raises for damage into one sentence with the file and the place."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigctl.errors import SessionError

HDF5_ERRORS = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    IndexError,
    OverflowError,
    MemoryError,
)
"""h5py chooses one of these by HDF5's own error number; damage can cause any."""
_ERRNO = re.compile(r"errno = (\d+)")
SHOWN_ERROR = 160
SHOWN_PLACE = 100


def damage(path: Path, place: str, what: str) -> SessionError:
    """Return the error for a place that is not as declared; ``what`` follows the place."""
    return SessionError(f"{path} is damaged: {shorten(place, SHOWN_PLACE)} {what}")


@contextmanager
def hdf5_errors(path: Path, place: str) -> Iterator[None]:
    """Raise SessionError for all that one call of h5py raises; hold nothing but that call."""
    try:
        yield
    except HDF5_ERRORS as error:
        raise SessionError(
            f"{path} is damaged: HDF5 cannot read {shorten(place, SHOWN_PLACE)}: {describe(error)}"
        ) from error


def system_error(error: BaseException) -> int:
    """Return the system's number of an error, which HDF5 puts into its text; 0 without one."""
    if found := _ERRNO.search(str(error)):
        return int(found[1])
    return (error.errno or 0) if isinstance(error, OSError) else 0


def system_reason(error: BaseException) -> str:
    """Return the system's words for an error, the error's own without a number."""
    code = system_error(error)
    return os.strerror(code) if code else describe(error)


def describe(error: BaseException) -> str:
    """Return an outside library's error as one short line."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    line = " ".join(text.split()) or type(error).__name__
    return shorten(line, SHOWN_ERROR)


def shorten(text: str, length: int) -> str:
    """Return a text of a file in at most ``length`` letters, control characters as ``?``.

    ``…`` stands for what is left out.
    """
    shown = "".join(letter if letter.isprintable() else "?" for letter in text[: length + 1])
    return shown if len(shown) <= length else f"{shown[: length - 1]}…"
