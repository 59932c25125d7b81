"""MATLAB 7.3 files: HDF5, read through the door that every HDF5 file goes through."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.errors import WrongUse
from rigctl.session.hdf5.hdf5_file import READ_BYTES, ROOT, Hdf5File
from rigctl.session.hdf5.schema import NUMBERS, REFERENCES, DataSetSchema

HIDDEN = ("#", "__")
DEEPEST = 32
MOST_VARIABLES = 100_000
_CLASS = "MATLAB_class"


def read_mat73(path: Path) -> dict[str, Any]:
    """Return all variables by name; what is no array of numbers or text is an empty object.

    Raises WrongUse for damage, for links to other files, and for variables that need more than
    twice the file's memory.
    """
    with Hdf5File(path) as file:
        reader = _VariableReader(file)
        variables: dict[str, Any] = {}
        for name in file.members(ROOT):
            if not name.startswith(HIDDEN):
                variables.update(reader.walk(name, f"/{name}", 0))
        return variables


class _VariableReader:
    """Reader of one file's variables, which counts what it has read: cells may share arrays."""

    def __init__(self, file: Hdf5File) -> None:
        self._file = file
        self._bytes_left = max(2 * file.file_bytes, READ_BYTES)
        self._variables_left = MOST_VARIABLES

    def walk(self, name: str, path: str, depth: int) -> Iterator[tuple[str, Any]]:
        """Yield the arrays inside an object: structures are groups, cells are references."""
        self._count(depth)
        if self._file.is_group(path):
            for key in self._file.members(path):
                yield from self._walk_field(f"{name}.{key}", name, key, f"{path}/{key}", depth + 1)
        elif self._is_reference(path):
            for number, target in enumerate(self._file.references(path), 1):
                yield from self.walk(f"{name}.{number}", target, depth + 1)
        else:
            yield name, self._read(path)

    def _walk_field(
        self, field: str, name: str, key: str, path: str, depth: int
    ) -> Iterator[tuple[str, Any]]:
        """Yield the arrays of a field; an array of structures has a reference for each element."""
        is_array = self._is_reference(path) and self._matlab_class(path) != "cell"
        if not is_array:
            yield from self.walk(field, path, depth)
            return
        for number, target in enumerate(self._file.references(path), 1):
            yield from self.walk(f"{name}.{number}.{key}", target, depth)

    def _is_reference(self, path: str) -> bool:
        if self._file.is_group(path):
            return False
        if not self._file.is_checked(path):
            self._file.check([DataSetSchema(path, None, NUMBERS + REFERENCES, other=True)])
        return self._file.kind(path) == REFERENCES

    def _matlab_class(self, path: str) -> str:
        return str(self._file.attribute(path, _CLASS) or "")

    def _read(self, path: str) -> Any:
        if self._file.kind(path) not in NUMBERS:
            return np.empty((), object)
        self._bytes_left -= int(np.prod(self._file.shape(path), dtype=float)) * 8
        if self._bytes_left < 0:
            raise WrongUse(f"{self._file.path}: its variables need too much memory for its size")
        # MATLAB stores columns first, HDF5 rows.
        values = self._file.array(path, self._file.dtype(path)).T
        if self._matlab_class(path) == "char":
            return np.array("".join(map(_letter, values.ravel().tolist())))
        return values

    def _count(self, depth: int) -> None:
        self._variables_left -= 1
        if depth > DEEPEST or self._variables_left < 0:
            raise WrongUse(
                f"{self._file.path}: its variables are nested more than {DEEPEST} deep, or are "
                f"more than {MOST_VARIABLES}: save arrays of numbers alone"
            )


def _letter(code: float) -> str:
    return chr(int(code)) if 0 <= code < 0x110000 else "\ufffd"
