"""MATLAB files, 5 and 7.3, read as variables by name; fields of structures have dotted names.

What only MATLAB reads, such as a table, is an array of objects that holds the name of its class.

``run.force`` is the field ``force`` of the structure ``run``; ``run.2.force`` is that of the second
element where ``run`` is an array of structures; ``cells.3`` is the third cell. Numbers start at 1.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse
from rigctl.session.hdf5_file import HDF5_ERRORS, NUMBERS, describe

HIDDEN = ("#", "__")
DEEPEST = 32
_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512


def read_mat(path: Path) -> dict[str, Any]:
    """Return all variables by name; what is no array of numbers or text is an object.

    Raises WrongUse for a damaged file, for cells nested without an end, and for data in other
    files.
    """
    from scipy.io.matlab import MatReadError

    with open_file(path) as file:
        start = file.read(_MATLAB_HEADER + len(_HDF5_MAGIC))
    is_hdf5 = _HDF5_MAGIC in (start[: len(_HDF5_MAGIC)], start[_MATLAB_HEADER:])
    try:
        variables = _read_mat73(path) if is_hdf5 else _read_mat5(path)
    except (*HDF5_ERRORS, NotImplementedError, zlib.error, MatReadError) as error:
        raise WrongUse(f"{path} is not a MATLAB file, or is damaged: {describe(error)}") from error
    return {name: value for name, value in variables.items() if not name.startswith(HIDDEN)}


def _read_mat5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    return dict(_flatten("", loadmat(str(path), simplify_cells=True)))


def _flatten(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the arrays inside a value with their dotted names."""
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque):
        yield name, _only_matlab(value["s2"].reshape(-1)[0])
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _flatten(f"{name}.{key}" if name else str(key), item)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for number, item in enumerate(np.asarray(value, dtype=object).ravel().tolist(), 1):
            yield from _flatten(f"{name}.{number}", item)
    else:
        yield name, value


def _read_mat73(path: Path) -> dict[str, Any]:
    with h5py.File(path, "r") as file:
        names = [name for name in file if not name.startswith(HIDDEN)]
        return dict(pair for name in names for pair in _walk(name, member(file, name), 0))


def member(group: Any, name: str) -> Any:
    """Return a member of a group. Raises ValueError if it is not in the file itself."""
    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{group.name}/{name} is a link to another place".replace("//", "/"))
    return _inside(group[name])


def _inside(node: Any) -> Any:
    """Return an object whose values are in the file itself."""
    if isinstance(node, h5py.Dataset) and (node.is_virtual or node.external):
        raise ValueError(f"{node.name} is stored outside the file")
    return node


def _walk(name: str, node: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield the arrays inside an object: structures are groups, cells are references."""
    if depth > DEEPEST:
        raise ValueError(f"its variables are nested more than {DEEPEST} deep")
    if isinstance(node, h5py.Group):
        for key in node:
            yield from _walk_field(name, key, member(node, key), depth + 1)
    elif _is_reference(node):
        for number, target in enumerate(_targets(node), 1):
            yield from _walk(f"{name}.{number}", target, depth + 1)
    else:
        yield name, _read(node)


def _walk_field(name: str, key: str, node: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield the arrays of a field; an array of structures has a reference for each element."""
    if not _is_reference(node) or _matlab_class(node) == "cell":
        yield from _walk(f"{name}.{key}", node, depth)
        return
    for number, target in enumerate(_targets(node), 1):
        yield from _walk(f"{name}.{number}.{key}", target, depth)


def _is_reference(node: Any) -> bool:
    return isinstance(node, h5py.Dataset) and h5py.check_ref_dtype(node.dtype) is not None


def _targets(node: Any) -> Iterator[Any]:
    """Yield the objects that a data set of references leads to, columns first."""
    for reference in np.asarray(node[()], dtype=object).T.ravel():  # a single one is no array
        yield _inside(node.file[reference])


def _matlab_class(node: Any) -> str:
    value = node.attrs.get("MATLAB_class", b"")
    return value.decode() if isinstance(value, bytes) else str(value)


def _read(node: Any) -> Any:
    if "MATLAB_object_decode" in node.attrs:
        return _only_matlab(_matlab_class(node))
    if node.dtype.kind not in NUMBERS:
        return np.empty((), object)
    values = node[()].T  # MATLAB stores columns first, HDF5 rows
    if _matlab_class(node) == "char":
        return np.array("".join(map(_letter, values.ravel().tolist())))
    return values


def _only_matlab(kind: str | bytes) -> NDArray[np.object_]:
    return np.array(kind.decode() if isinstance(kind, bytes) else kind, object)


def _letter(code: float) -> str:
    return chr(int(code)) if 0 <= code < 0x110000 else "\ufffd"
