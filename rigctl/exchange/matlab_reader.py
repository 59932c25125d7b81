"""MATLAB files, 5 and 7.3, read as variables by name; fields of structures have dotted names.

``run.force`` is the field ``force`` of the structure ``run``; ``run.2.force`` is that of the second
element where ``run`` is an array of structures; ``cells.3`` is the third cell. Numbers start at 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.errors import WrongUse

_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512
_HIDDEN = ("#", "__")


def read_mat(path: Path) -> dict[str, Any]:
    """Return all variables by name, those that are not arrays of numbers included."""
    with path.open("rb") as file:
        start = file.read(_MATLAB_HEADER + len(_HDF5_MAGIC))
    is_hdf5 = _HDF5_MAGIC in (start[: len(_HDF5_MAGIC)], start[_MATLAB_HEADER:])
    variables = _read_hdf5(path) if is_hdf5 else _read_mat5(path)
    return {name: value for name, value in variables.items() if not name.startswith(_HIDDEN)}


def _read_mat5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    # SciPy raises these for what it cannot read, NotImplementedError for a newer format.
    try:
        variables = loadmat(str(path), simplify_cells=True)
    except (ValueError, TypeError, NotImplementedError, MatReadError, IndexError) as error:
        raise WrongUse(f"{path} is not a MATLAB file, or is damaged: {error}") from error
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


def _read_hdf5(path: Path) -> dict[str, Any]:
    try:
        with h5py.File(path, "r") as file:
            return {
                name: value
                for key in file
                if not key.startswith(_HIDDEN)
                for name, value in _walk(file, key, file[key])
            }
    except (OSError, RuntimeError, KeyError) as error:
        raise WrongUse(f"{path} is not a MATLAB 7.3 file, or is damaged: {error}") from error


def _walk(file: Any, name: str, node: Any) -> Iterator[tuple[str, Any]]:
    """Yield the arrays inside a node: structures are groups; cells and arrays are references."""
    if isinstance(node, h5py.Group):
        for key, item in node.items():
            if _is_reference(item) and _matlab_class(item) != "cell":
                for number, target in enumerate(_dereference(file, item), 1):
                    yield from _walk(file, f"{name}.{number}.{key}", target)
            else:
                yield from _walk(file, f"{name}.{key}", item)
    elif _is_reference(node):
        for number, target in enumerate(_dereference(file, node), 1):
            yield from _walk(file, f"{name}.{number}", target)
    elif _matlab_class(node) == "char":
        yield name, np.array("".join(map(chr, node[()].T.ravel())))
    else:
        # MATLAB stores columns first, HDF5 rows.
        yield name, np.asarray(node[()]).T


def _is_reference(node: Any) -> bool:
    return isinstance(node, h5py.Dataset) and h5py.check_ref_dtype(node.dtype) is not None


def _matlab_class(node: Any) -> str:
    name = node.attrs.get("MATLAB_class", b"")
    return name.decode() if isinstance(name, bytes) else str(name)


def _dereference(file: Any, node: Any) -> list[Any]:
    return [file[reference] for reference in node[()].T.ravel()]
