"""MATLAB files, 5 and 7.3, read as variables by name; fields of structures have dotted names.

``run.force`` is the field ``force`` of the structure ``run``; ``run.2.force`` is that of the second
element where ``run`` is an array of structures; ``cells.3`` is the third cell. Numbers start at 1.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse
from rigctl.exchange.matlab.mat5_structure import check_mat5
from rigctl.exchange.matlab.mat73_reader import HIDDEN, read_mat73
from rigctl.session.hdf5.errors import describe
from rigctl.session.hdf5.probe import survives

READ_BYTES_PER_S = 20e6
"""A tenth of the measured speed: an import is read twice, first by a process that may die."""
_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512
_READER_ERRORS = (
    ValueError,
    TypeError,
    IndexError,
    KeyError,
    OverflowError,
    MemoryError,
    zlib.error,
)
"""What SciPy's reader raises for damage inside a structure that is sound to our check."""


def read_mat(path: Path) -> dict[str, Any]:
    """Return all variables by name, those that are not arrays of numbers included.

    Raises WrongUse for a damaged file and for variables larger than the file can hold.
    """
    with open_file(path) as file:
        start = file.read(_MATLAB_HEADER + len(_HDF5_MAGIC))
    is_hdf5 = _HDF5_MAGIC in (start[: len(_HDF5_MAGIC)], start[_MATLAB_HEADER:])
    variables = read_mat73(path) if is_hdf5 else _read_mat5(path)
    return {name: value for name, value in variables.items() if not name.startswith(HIDDEN)}


def _read_mat5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    with open_file(path) as file:
        content = file.read()
    try:
        check_mat5(content)
    except (ValueError, zlib.error) as error:
        raise _damaged(path, error) from error
    # SciPy's compiled reader can die of structures that are sound to our check.
    if not survives("mat5", path, 1.0 + len(content) / READ_BYTES_PER_S):
        raise _damaged(path, ValueError("a process that reads it dies of it, or never ends"))
    try:
        variables = loadmat(str(path), simplify_cells=True)
    except (*_READER_ERRORS, MatReadError) as error:
        raise _damaged(path, error) from error
    return dict(_flatten("", variables))


def _damaged(path: Path, error: Exception) -> WrongUse:
    return WrongUse(f"{path} is not a MATLAB file, or is damaged: {describe(error)}")


def _flatten(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the arrays inside a value with their dotted names."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flatten(f"{name}.{key}" if name else str(key), item)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for number, item in enumerate(np.asarray(value, dtype=object).ravel().tolist(), 1):
            yield from _flatten(f"{name}.{number}", item)
    else:
        yield name, value
