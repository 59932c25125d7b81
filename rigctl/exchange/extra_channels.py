"""Channels of an imported recording that are neither taxels nor load cell: ``extra.h5``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py

from rigctl.exchange.resampling import Floats

FILE = "extra.h5"
DOC = (
    "row i belongs to the session's i-th sample over all parts; NaN where the file had no value; "
    "columns in the order of the attribute names"
)


class ExtraChannels:
    """Appends rows, float64 (n, channels), beside the session; no file without channels."""

    def __init__(self, folder: Path, wanted: Sequence[str]) -> None:
        self._file: Any = None
        if wanted:
            self._file = h5py.File(folder / FILE, "x")
            self._file.attrs["doc"] = DOC
            self._file.attrs["names"] = list(wanted)

    def append(self, rows: Floats) -> None:
        """Add the rows of one trial."""
        if self._file is None:
            return
        width = rows.shape[1]
        if "values" not in self._file:
            self._file.create_dataset(
                "values", (0, width), "f8", maxshape=(None, width), chunks=(4096, width)
            )
        data = self._file["values"]
        start = data.shape[0]
        data.resize(start + len(rows), axis=0)
        data[start:] = rows

    def __enter__(self) -> ExtraChannels:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()
