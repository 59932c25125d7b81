"""Read and write HDF5 arrays, texts and attributes; each array has its unit, meaning and shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

Attributes = dict[str, str | int | float]


def write_attributes(node: Any, attributes: Attributes) -> None:
    """Write attributes; text becomes fixed-length UTF-8."""
    for name, value in attributes.items():
        node.attrs.create(name, text_scalar(value) if isinstance(value, str) else value)


def read_attributes(node: Any) -> dict[str, Any]:
    """Return the attributes of a file, group or data set as Python's own types."""
    return {name: _to_python(value) for name, value in node.attrs.items()}


def text_scalar(text: str) -> NDArray[np.bytes_]:
    """Return ``text`` as a zero-dimensional fixed-length string that HDF5 marks as UTF-8."""
    data = text.encode()
    return np.array(data, dtype=h5py.string_dtype("utf-8", max(1, len(data))))


def write_array(
    group: Any, name: str, values: NDArray[Any] | float, unit: str, doc: str, shape: str = ""
) -> None:
    """Write numbers; ``shape`` names the axes, empty for a single value."""
    attributes: Attributes = {
        "unit": unit or "none",
        "doc": doc,
        "shape": f"({shape})" if shape else "()",
    }
    write_attributes(group.create_dataset(name, data=values), attributes)


def write_text(group: Any, name: str, text: str, doc: str) -> None:
    """Write one text, UTF-8 of fixed length."""
    dataset = group.create_dataset(name, data=text_scalar(text))
    write_attributes(dataset, {"doc": doc, "shape": "()"})


def write_texts(group: Any, name: str, texts: Sequence[str], doc: str, shape: str) -> None:
    """Write several texts, UTF-8 of one fixed length."""
    encoded = [text.encode() for text in texts]
    width = max([1, *map(len, encoded)])
    array = np.array(encoded, dtype=h5py.string_dtype("utf-8", width))
    dataset = group.create_dataset(name, data=array)
    write_attributes(dataset, {"doc": doc, "shape": f"({shape})"})


def read_text(group: Any, name: str) -> str:
    """Return one stored text. Raises KeyError where there is none."""
    return bytes(group[name][()]).decode()


def _to_python(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode().rstrip("\0")
    if isinstance(value, np.ndarray):
        return [_to_python(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value
