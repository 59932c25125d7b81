"""Turn what HDF5 raises for damage into one sentence with the file and the place."""

from __future__ import annotations

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
SHOWN_ERROR = 160


def damage(path: Path, place: str, what: str) -> SessionError:
    """Return the error for a place that is not as declared; ``what`` follows the place."""
    return SessionError(f"{path} is damaged: {place} {what}")


@contextmanager
def hdf5_errors(path: Path, place: str) -> Iterator[None]:
    """Raise SessionError for all that one call of h5py raises; hold nothing but that call."""
    try:
        yield
    except HDF5_ERRORS as error:
        raise SessionError(
            f"{path} is damaged: HDF5 cannot read {place}: {describe(error)}"
        ) from error


def describe(error: BaseException) -> str:
    """Return an outside library's error as one short line."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    line = " ".join(text.split()) or type(error).__name__
    return line if len(line) <= SHOWN_ERROR else f"{line[:SHOWN_ERROR]}…"
