"""Make a session one of an earlier version, whose trials have no column for the mounting."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from rigctl.session.format.layout import TRIALS
from tests.session.forging import rewrite_digests


def without_mounts(folder: Path) -> None:
    """Store every part of a session as before the column ``mount``."""
    for path in folder.glob("part-*.h5"):
        with h5py.File(path, "r+") as file:
            _without_mounts(file)
    rewrite_digests(folder)


def _without_mounts(file: h5py.File) -> None:
    now = file[TRIALS.path]
    rows, attributes, chunks = now[:], dict(now.attrs), now.chunks
    older = np.empty(rows.shape, TRIALS.older_dtype)
    for name in older.dtype.names or ():
        older[name] = rows[name]
    del file[TRIALS.path]
    dataset = file.create_dataset(
        TRIALS.path, data=older, dtype=older.dtype, maxshape=(None,), chunks=chunks
    )
    attributes["columns"] = attributes["columns"][:-1]
    for name, value in attributes.items():
        dataset.attrs.create(name, value)
