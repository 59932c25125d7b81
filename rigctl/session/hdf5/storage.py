"""Check how a data set is stored before anything is read: in this file, plainly, and really there.

HDF5 follows links and descriptions without asking: to other files, through filters loaded from
plug-ins, into memory of any size. So only what rigctl writes is accepted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5t, h5z

from rigctl.session.hdf5.errors import damage, hdf5_errors
from rigctl.session.hdf5.schema import REFERENCES, TEXT, DataSetSchema

_LAYOUTS = (h5d.CONTIGUOUS, h5d.CHUNKED, h5d.COMPACT)
_FILTERS = {h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32}
_PLAIN = (h5t.INTEGER, h5t.FLOAT, h5t.ENUM)
MOST_NUMBER_BYTES = 8
MOST_CHUNK_BYTES = 64 << 20
"""HDF5 holds a whole compressed chunk in memory; rigctl's largest has 8 MiB."""
ADDRESS_BYTES = 8
DEFLATE_RATIO = 1032
"""Deflate cannot expand more than this."""


@dataclass(frozen=True, slots=True)
class CheckedDataSet:
    """A data set that is as declared. ``chunk`` is the shape of its chunks, empty without any."""

    dataset: Any
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    chunk: tuple[int, ...]
    filters: frozenset[int]

    @property
    def kind(self) -> str:
        """NumPy's kind, REFERENCES or OTHER."""
        return REFERENCES if self.dtype == h5py.ref_dtype else self.dtype.kind

    @property
    def row_bytes(self) -> int:
        """Size of a row in memory."""
        return prod(self.shape[1:]) * self.dtype.itemsize


def check_dataset(node: h5d.DatasetID, schema: DataSetSchema, path: Path) -> CheckedDataSet:
    """Check a data set's storage, type and shape, in this order, before its first read.

    Its storage comes first: HDF5 opens the sources of a virtual data set to know its shape. Raises
    SessionError.
    """
    chunk, filters = _check_storage(node, path, schema.path)
    with hdf5_errors(path, schema.path):
        dtype = _read_type(node.get_type(), schema)
        if dtype is None and schema.older_dtype is not None:
            older = replace(schema, dtype=schema.older_dtype, older_dtype=None)
            dtype = _read_type(node.get_type(), older)
        shape = node.shape
    if dtype is None:
        raise damage(path, schema.path, f"is not {_type_name(schema)}")
    if (
        shape is None
        or schema.rank not in (None, len(shape))
        or schema.tail not in (None, shape[1:])
    ):
        raise damage(path, schema.path, f"has shape {shape}, not {_shape_name(schema)}")
    return CheckedDataSet(h5py.Dataset(node), dtype, shape, chunk, filters)


def check_size(
    checked: CheckedDataSet, path: Path, place: str, file_bytes: int, is_cut: bool
) -> None:
    """Raise SessionError for a data set larger than its file can hold, and for giant chunks.

    ``is_cut``: the end of the file may be missing, so the addresses of its chunks are the limit.
    """
    size = checked.dtype.itemsize
    chunk_bytes = prod(checked.chunk) * size if checked.chunk else 0
    n_bytes = prod(checked.shape) * size
    if chunk_bytes > MOST_CHUNK_BYTES:
        raise damage(path, place, f"has chunks of {chunk_bytes} bytes")
    ratio = DEFLATE_RATIO if h5z.FILTER_DEFLATE in checked.filters else 1
    most = max(file_bytes * ratio, file_bytes // ADDRESS_BYTES * chunk_bytes * is_cut)
    if n_bytes > most + chunk_bytes:
        raise damage(path, place, f"claims {n_bytes} bytes in a file of {file_bytes}")


def _check_storage(
    node: h5d.DatasetID, path: Path, place: str
) -> tuple[tuple[int, ...], frozenset[int]]:
    """Return the shape of the chunks and the filters. Refuse other files and unknown filters."""
    with hdf5_errors(path, place):
        plan = node.get_create_plist()
        layout, n_external = plan.get_layout(), plan.get_external_count()
        filters = frozenset(plan.get_filter(i)[0] for i in range(plan.get_nfilters()))
        chunk = plan.get_chunk() if layout == h5d.CHUNKED else ()
    if layout not in _LAYOUTS or n_external:
        raise damage(path, place, "is stored outside the file, where nothing may be read")
    if not filters <= _FILTERS:
        raise damage(path, place, f"has filter {max(filters - _FILTERS)}, which may not be run")
    return chunk, filters


def _read_type(kind: Any, schema: DataSetSchema) -> np.dtype[Any] | None:
    """Return the stored type as NumPy's, None for another than declared.

    Compounds with other fields, texts of variable length, references and nested types are refused
    before NumPy sees them.
    """
    if schema.dtype is not None and kind.equal(_stored_type(schema.dtype)):
        return schema.dtype
    if not _is_plain(kind, schema.dtype):
        if REFERENCES in schema.kinds and kind.equal(h5t.STD_REF_OBJ):
            references: np.dtype[Any] = h5py.ref_dtype
            return references
        return np.dtype(f"V{kind.get_size()}") if schema.other else None
    found: np.dtype[Any] = kind.dtype
    if schema.other and found.kind not in schema.kinds:
        return np.dtype(f"V{found.itemsize}")
    same = found.kind in schema.kinds if schema.dtype is None else found == schema.dtype
    return found if same else None


@cache
def _stored_type(dtype: np.dtype[Any]) -> Any:
    return h5t.py_create(dtype, logical=True)


def _is_plain(kind: Any, dtype: np.dtype[Any] | None) -> bool:
    """Return whether an HDF5 type is as simple as declared: no text of variable length inside."""
    if kind.get_class() != h5t.COMPOUND:
        return _is_scalar(kind)
    columns = () if dtype is None else dtype.names or ()
    return kind.get_nmembers() == len(columns) and all(
        _is_scalar(kind.get_member_type(i)) for i in range(len(columns))
    )


def _is_scalar(kind: Any) -> bool:
    if kind.get_class() == h5t.STRING:
        return not kind.is_variable_str()
    return kind.get_class() in _PLAIN and kind.get_size() <= MOST_NUMBER_BYTES


def _type_name(schema: DataSetSchema) -> str:
    if schema.dtype is None:
        return "text of fixed length" if schema.kinds == TEXT else "plain numbers"
    return "a table of its layout's columns" if schema.dtype.names else f"of type {schema.dtype}"


def _shape_name(schema: DataSetSchema) -> str:
    axes = ["n"] * (schema.rank or 0)
    if schema.tail is not None:
        axes[1:] = map(str, schema.tail)
    return f"({', '.join(axes)})"
