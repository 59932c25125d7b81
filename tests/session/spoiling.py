"""Changes to the rows of an open part, each made by a function of its HDF5 file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import h5py

Spoil = Callable[[h5py.File], None]


def set_row(path: str, row: int, **values: object) -> Spoil:
    """Return what sets columns of one row of a table; they have other values before."""

    def spoil(file: h5py.File) -> None:
        changed = file[path][row]
        for name, value in values.items():
            assert changed[name] != value, f"{name} of row {row} of {path} is {value} already"
            changed[name] = value
        file[path][row] = changed

    return spoil


def set_array(path: str, at: Any, value: int) -> Spoil:
    """Return what sets elements of an array."""

    def spoil(file: h5py.File) -> None:
        file[path][at] = value

    return spoil
