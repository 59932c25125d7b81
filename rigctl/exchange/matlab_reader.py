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
from rigctl.exchange.mat5_structure import check_mat5
from rigctl.exchange.mat73_reader import HIDDEN, read_mat73
from rigctl.session.hdf5.errors import describe
from rigctl.session.hdf5.probe import survives

READ_BYTES_PER_S = 20e6
"""A tenth of the measured speed: an import is read twice, first by a process that may die."""
_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512


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

    # SciPy raises these for what it cannot read, NotImplementedError for a newer format.
    unreadable = (ValueError, TypeError, NotImplementedError, MatReadError, IndexError, KeyError)
    try:
        with open_file(path) as file:
            check_mat5(file.read())
        # SciPy's compiled reader can die of structures that are sound to our check.
        processor_s = 1.0 + path.stat().st_size / READ_BYTES_PER_S
        if not survives("mat5", path, processor_s):
            raise ValueError("a process that reads it dies of it, or never ends")
        variables = loadmat(str(path), simplify_cells=True)
    except (*unreadable, zlib.error, OverflowError, MemoryError) as error:
        raise WrongUse(f"{path} is not a MATLAB file, or is damaged: {describe(error)}") from error
    return dict(_flatten("", variables))


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
