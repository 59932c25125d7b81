"""Read the attributes of an object: numbers and texts of fixed length, bounded in size."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from h5py import h5a, h5t

from rigctl.session.hdf5.errors import damage, hdf5_errors

MOST_ATTRIBUTES = 256
MOST_BYTES = 1 << 20
"""Limit for one attribute; a session's longest is the JSON of 1024 taxels."""
_PLAIN = (h5t.INTEGER, h5t.FLOAT, h5t.STRING, h5t.ENUM)


def read_attributes(node: Any, path: Path, place: str) -> dict[str, Any]:
    """Return the attributes of an h5py identifier as Python's own types.

    Raises SessionError for damage, for text of variable length and for any type but plain numbers
    and texts, in at most one dimension.
    """
    names: list[bytes] = []
    with hdf5_errors(path, f"the attributes of {place}"):
        if h5a.get_num_attrs(node) <= MOST_ATTRIBUTES:
            h5a.iterate(node, names.append)
            return {
                name.decode(): _read(node, name, path, f"attribute {name.decode()} of {place}")
                for name in names
            }
    raise damage(path, place, f"has more than {MOST_ATTRIBUTES} attributes")


def read_attribute(node: Any, name: str, path: Path, place: str) -> Any:
    """Return one attribute as :func:`read_attributes` does, None where there is none."""
    with hdf5_errors(path, f"attribute {name} of {place}"):
        if not h5a.exists(node, name.encode()):
            return None
    return _read(node, name.encode(), path, f"attribute {name} of {place}")


def _read(node: Any, name: bytes, path: Path, place: str) -> Any:
    with hdf5_errors(path, place):
        attribute = h5a.open(node, name)
        kind, shape = attribute.get_type(), attribute.shape
        type_class, size = kind.get_class(), kind.get_size()
    is_text = type_class == h5t.STRING
    if type_class not in _PLAIN or (is_text and kind.is_variable_str()):
        raise damage(path, place, "is neither a number nor a text of fixed length")
    if shape is None or len(shape) > 1 or size * prod(shape) > MOST_BYTES:
        raise damage(path, place, f"has shape {shape}, each value {size} bytes")
    with hdf5_errors(path, place):
        values = np.zeros(shape, f"S{size}" if is_text else attribute.dtype)
        attribute.read(values, mtype=kind if is_text else None)
        return _to_python(values)


def _to_python(values: Any) -> Any:
    """Return a number, a text or a list of these. Raises ValueError for text that is not UTF-8."""
    if values.ndim:
        return [_to_python(value) for value in values]
    value = values.item()
    return value.decode().rstrip("\0") if isinstance(value, bytes) else value
