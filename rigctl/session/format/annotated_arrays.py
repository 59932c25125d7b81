"""Values in an HDF5 file that explain themselves: each with its unit, meaning and shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout


def put_array(
    group: Any, name: str, values: NDArray[Any] | float, unit: str, doc: str, shape: str = ""
) -> None:
    """Store numbers; ``shape`` names the axes, empty for a single value."""
    described: dict[str, str | int | float] = {
        "unit": unit or "none",
        "doc": doc,
        "shape": f"({shape})" if shape else "()",
    }
    layout.describe(group.create_dataset(name, data=values), described)


def put_text(group: Any, name: str, text: str, doc: str) -> None:
    """Store one text, UTF-8 of fixed length."""
    dataset = group.create_dataset(name, data=layout.text_array(text))
    layout.describe(dataset, {"doc": doc, "shape": "()"})


def put_texts(group: Any, name: str, texts: Sequence[str], doc: str, shape: str) -> None:
    """Store several texts, UTF-8 of one fixed length."""
    encoded = [text.encode() for text in texts]
    width = max([1, *map(len, encoded)])
    array = np.array(encoded, dtype=h5py.string_dtype("utf-8", width))
    dataset = group.create_dataset(name, data=array)
    layout.describe(dataset, {"doc": doc, "shape": f"({shape})"})


def take_array(group: Any, name: str, kind: Any = np.float64) -> NDArray[Any]:
    """Numbers as they were stored, in C order. Raises KeyError where there are none."""
    return np.ascontiguousarray(group[name][()], dtype=kind)


def take_text(group: Any, name: str) -> str:
    """One text. Raises KeyError where there is none."""
    return bytes(group[name][()]).decode()


def take_texts(group: Any, name: str) -> tuple[str, ...]:
    """Several texts. Raises KeyError where there are none."""
    return tuple(bytes(item).decode() for item in group[name][()])
