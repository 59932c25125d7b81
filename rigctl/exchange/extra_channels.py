"""Channels of an imported recording that are neither taxels nor load cell: ``extra.h5``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py

from rigctl.exchange.resampling import Floats

FILE = "extra.h5"
DOC = (
    "row i belongs to the session's i-th sample over all parts; NaN where the file had no value; "
    "columns in the order of the attribute names"
)


class ExtraChannels:
    """Writer of ``extra.h5`` beside the session, a no-op without channels."""

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._file: Any = None
        if names:
            self._file = h5py.File(folder / FILE, "x")
            self._file.attrs["doc"] = DOC
            self._file.attrs["names"] = list(names)

    def append(self, rows: Floats) -> None:
        """Append the rows of one trial, float64 (n, channels)."""
        if self._file is None:
            return
        width = rows.shape[1]
        if "values" not in self._file:
            self._file.create_dataset(
                "values", (0, width), "f8", maxshape=(None, width), chunks=(4096, width)
            )
        values = self._file["values"]
        start = values.shape[0]
        values.resize(start + len(rows), axis=0)
        values[start:] = rows

    def __enter__(self) -> ExtraChannels:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
