"""MATLAB files, 5 and 7.3, as variables by name: the fields of a structure have dotted names.

``run.force`` is the field ``force`` of the structure ``run``; ``run.2.force`` that of the second
one where ``run`` is an array of structures; ``cells.3`` is the third cell. Counted from 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.errors import WrongUse

_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB_HEADER = 512
_HIDDEN = ("#", "__")


def read_mat(path: Path) -> dict[str, Any]:
    """All variables; what is no array of numbers is there too, for whoever asks for it by name."""
    with path.open("rb") as file:
        start = file.read(_MATLAB_HEADER + len(_HDF5_MAGIC))
    newer = _HDF5_MAGIC in (start[: len(_HDF5_MAGIC)], start[_MATLAB_HEADER:])
    named = _mat73(path) if newer else _mat5(path)
    return {name: value for name, value in named.items() if not name.startswith(_HIDDEN)}


def _mat5(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    # SciPy says with these what it cannot read; NotImplementedError is its word for a newer format.
    try:
        found = loadmat(str(path), simplify_cells=True)
    except (ValueError, TypeError, NotImplementedError, MatReadError, IndexError) as error:
        raise WrongUse(f"{path} is no MATLAB file, or is damaged: {error}") from error
    return dict(_flat("", found))


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Arrays below a value, with their dotted names."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{name}.{key}" if name else str(key), item)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for number, item in enumerate(np.asarray(value, dtype=object).ravel().tolist(), 1):
            yield from _flat(f"{name}.{number}", item)
    else:
        yield name, value


def _mat73(path: Path) -> dict[str, Any]:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return {
                name: value
                for key in file
                if not key.startswith(_HIDDEN)
                for name, value in _below(file, key, file[key])
            }
    except (OSError, RuntimeError, KeyError) as error:
        raise WrongUse(f"{path} is no MATLAB 7.3 file, or is damaged: {error}") from error


def _below(file: Any, name: str, node: Any) -> Iterator[tuple[str, Any]]:
    """Arrays below a node: a structure is a group, cells and its arrays are references."""
    import h5py

    if isinstance(node, h5py.Group):
        for key, item in node.items():
            if _refers(item) and _class_of(item) != "cell":
                for number, target in enumerate(_targets(file, item), 1):
                    yield from _below(file, f"{name}.{number}.{key}", target)
            else:
                yield from _below(file, f"{name}.{key}", item)
    elif _refers(node):
        for number, target in enumerate(_targets(file, node), 1):
            yield from _below(file, f"{name}.{number}", target)
    elif _class_of(node) == "char":
        yield name, np.array("".join(map(chr, node[()].T.ravel())))
    else:
        # MATLAB counts columns first, HDF5 rows.
        yield name, np.asarray(node[()]).T


def _refers(node: Any) -> bool:
    import h5py

    return isinstance(node, h5py.Dataset) and h5py.check_ref_dtype(node.dtype) is not None


def _class_of(node: Any) -> str:
    said = node.attrs.get("MATLAB_class", b"")
    return said.decode() if isinstance(said, bytes) else str(said)


def _targets(file: Any, node: Any) -> list[Any]:
    return [file[reference] for reference in node[()].T.ravel()]
