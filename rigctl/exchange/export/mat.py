"""A session as one MATLAB 7.3 file, which MATLAB, Octave, Julia and mat73 read.

The format is HDF5 with MATLAB's header in front and its classes as attributes. Axes are turned
round there, so a data set of 18 × n is a matrix of n × 18. Each series is a structure with its
``n_rows`` and a column vector or matrix for each column, none where there are no rows. Texts are
character matrices, a row each: Octave reads no cells.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.exchange.export.content import Column, Content, Series, SpikeTrains
from rigctl.exchange.export.tables import all_series

HEADER_BYTES = 512
CHUNK_ROWS = 1 << 14
CLASSES = {"float64": "double", "float32": "single"}
"""MATLAB's name of a type where it differs from NumPy's."""
LIBVER = ("earliest", "v110")


def write_mat(content: Content, spikes: SpikeTrains | None, target: Path) -> None:
    """Write a session into a new ``.mat`` file."""
    with h5py.File(target, "w", userblock_size=HEADER_BYTES, libver=LIBVER) as file:
        about = _structure(file, "about")
        for name, value in content.about.items():
            _write_value(about, name, value)
        for series in all_series(content, spikes):
            _write_series(_structure(file, series.name), series)
    with target.open("r+b") as raw:
        text = b"MATLAB 7.3 MAT-file, Platform: rigctl, HDF5 schema 1.00 ."
        raw.write(text.ljust(116) + bytes(8) + b"\x00\x02IM")


def _structure(parent: Any, name: str) -> Any:
    group = parent.create_group(name)
    group.attrs["MATLAB_class"] = np.bytes_("struct")
    return group


def _write_value(group: Any, name: str, value: str | int | float) -> None:
    if isinstance(value, str):
        _declare(
            group.create_dataset(name, data=_letters(np.array([value]), len(_units(value)))), "char"
        )
    else:
        _declare(group.create_dataset(name, data=np.array([[float(value)]])), "double")


def _write_series(group: Any, series: Series) -> None:
    """Append all blocks to a data set for each column, row after row of the last axis.

    A series without rows has none: MATLAB marks an empty column in a way that Octave takes for
    numbers.
    """
    sets: dict[str, Any] = {}
    n_rows = 0
    for block in series.blocks():
        found = len(block[series.columns[0].name])
        for column in series.columns if found else ():
            if column.name not in sets:
                sets[column.name] = _create(group, column)
            rows, dataset = block[column.name], sets[column.name]
            values = _letters(rows, dataset.shape[0]) if column.is_text else rows.T
            _append(dataset, values.reshape(-1, found))
        n_rows += found
    _write_value(group, "n_rows", n_rows)


def _create(group: Any, column: Column) -> Any:
    width = len(column.parts) or 1
    if column.is_text:
        width = max(1, column.dtype.itemsize // 4)
    dtype = np.dtype(np.uint16) if column.is_text else column.dtype
    chunk = max(1, CHUNK_ROWS * 18 // width) if width > 18 else CHUNK_ROWS
    dataset = group.create_dataset(
        column.name,
        (width, 0),
        dtype,
        maxshape=(width, None),
        chunks=(width, chunk),
        compression="gzip",
        compression_opts=4,
        shuffle=True,
    )
    _declare(dataset, "char" if column.is_text else CLASSES.get(dtype.name, dtype.name))
    return dataset


def _append(dataset: Any, values: NDArray[Any]) -> None:
    end = dataset.shape[1]
    dataset.resize(end + values.shape[1], axis=1)
    dataset[:, end:] = values


def _declare(dataset: Any, matlab_class: str) -> None:
    dataset.attrs["MATLAB_class"] = np.bytes_(matlab_class)
    if matlab_class == "char":
        dataset.attrs["MATLAB_int_decode"] = np.int32(2)


def _letters(texts: NDArray[np.str_], width: int) -> NDArray[np.uint16]:
    """Return texts as MATLAB's letters, uint16 (width, n), filled up with blanks."""
    out = np.full((len(texts), width), ord(" "), np.uint16)
    for row, text in zip(out, texts.tolist(), strict=True):
        letters = _units(text)[:width]
        row[: len(letters)] = letters
    return out.T


def _units(text: str) -> NDArray[np.uint16]:
    return np.frombuffer(text.encode("utf-16-le"), np.uint16)
