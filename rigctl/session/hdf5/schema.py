"""Declare the data sets of a file: path, number of axes, type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

NUMBERS = "biuf"
"""NumPy's kinds of plain numbers: Booleans, signed and unsigned integers, floating point."""
TEXT = "S"
"""NumPy's kind of text of fixed length."""
REFERENCES, OTHER = "R", "V"
"""Kinds of references to objects of the same file, and of types that are not read."""


@dataclass(frozen=True, slots=True)
class DataSetSchema:
    """An expected data set.

    ``tail`` has the lengths of all axes but the first; None stands for any lengths. A ``rank`` of 0
    is a single value, None any number of axes. ``dtype`` is the exact type, ``older_dtype`` that of
    files from before a change; without a ``dtype``, ``kinds`` lists NumPy's kinds that are
    accepted. An ``optional`` one may be missing. ``other``: any other type is accepted, too, but
    never read.
    """

    path: str
    rank: int | None = 0
    kinds: str = NUMBERS
    dtype: np.dtype[Any] | None = None
    tail: tuple[int, ...] | None = None
    optional: bool = False
    other: bool = False
    older_dtype: np.dtype[Any] | None = None


def numbers(path: str, rank: int = 0) -> DataSetSchema:
    """Return the schema of numbers with this number of axes."""
    return DataSetSchema(path, rank)


def text(path: str) -> DataSetSchema:
    """Return the schema of one text."""
    return DataSetSchema(path, 0, TEXT)


def texts(path: str) -> DataSetSchema:
    """Return the schema of a list of texts."""
    return DataSetSchema(path, 1, TEXT)
