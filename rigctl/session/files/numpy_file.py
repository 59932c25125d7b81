"""NumPy's .npy and .npz files: every header is checked before its array gets any memory."""

from __future__ import annotations

import lzma
import zipfile
import zlib
from math import prod
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

from numpy.lib import format as npy
from numpy.typing import NDArray

from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse
from rigctl.session.hdf5.errors import describe

UNPACKED_BYTES = 256 << 20
"""An archive may unpack to this much, or to twice its own size."""
MOST_MEMBERS = 10_000
_ZIP = b"PK"
_SUFFIX = ".npy"
_UNREADABLE = (
    ValueError,
    EOFError,
    RuntimeError,  # zipfile: a member is encrypted
    MemoryError,  # Python's parser: a header is nested too deep
    SyntaxError,
    TokenError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)
"""What NumPy and zipfile raise for damaged files."""


def read_numpy(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file by name; that of a .npy file has an empty name.

    Raises WrongUse for a damaged file, for Python objects, and for arrays larger than the file.
    """
    with open_file(path) as file:
        try:
            return parse_numpy(file, path.stat().st_size)
        except ValueError as error:
            raise WrongUse(
                f"{path} is not a NumPy file of plain numbers, or is damaged: {error}"
            ) from error


def parse_numpy(file: IO[bytes], size: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an open file of ``size`` bytes as :func:`read_numpy` does.

    Raises ValueError for whatever cannot be read.
    """
    is_archive = file.read(len(_ZIP)) == _ZIP
    file.seek(0)
    try:
        return _read_archive(file, size) if is_archive else {"": _read_array(file, size)}
    except _UNREADABLE as error:
        raise ValueError(describe(error)) from error


def _read_archive(file: IO[bytes], size: int) -> dict[str, NDArray[Any]]:
    with zipfile.ZipFile(file) as archive:
        members = [info for info in archive.infolist() if info.filename.endswith(_SUFFIX)]
        unpacked = sum(info.file_size for info in members)
        if len(members) > MOST_MEMBERS or unpacked > max(2 * size, UNPACKED_BYTES):
            raise ValueError(f"{len(members)} arrays of {unpacked} bytes in a file of {size}")
        arrays: dict[str, NDArray[Any]] = {}
        for info in members:
            with archive.open(info) as member:
                name = info.filename.removesuffix(_SUFFIX)
                arrays[name] = _read_array(member, info.file_size)
                if member.read(1):  # zipfile compares the checksum at the end of a member only
                    raise ValueError(f"{name} has bytes behind its array")
        return arrays


def _read_array(file: IO[bytes], size: int) -> NDArray[Any]:
    """Return an array of a file of ``size`` bytes. Raises ValueError before it gets memory."""
    version = npy.read_magic(file)
    read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(file)
    if dtype.hasobject:
        raise ValueError("its array holds Python objects")
    count: int = prod(shape)
    declared, left = count * dtype.itemsize, size - file.tell()
    if declared > left or min(shape, default=0) < 0 or (count and not dtype.itemsize):
        raise ValueError(f"its array of shape {shape} needs {declared} bytes, the file has {left}")
    file.seek(0)
    array: NDArray[Any] = npy.read_array(file, allow_pickle=False)
    return array
