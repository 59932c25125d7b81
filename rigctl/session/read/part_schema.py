"""What the data sets of a part must be: the schema of its layout."""

from __future__ import annotations

from functools import cache

import numpy as np

from rigctl.session.format.data_sets import DIGESTS, TEXTS, SessionLayout
from rigctl.session.hdf5_file import DataSetSchema, text


@cache
def part_schema(layout: SessionLayout, n_taxels: int) -> tuple[DataSetSchema, ...]:
    """Return the data sets of a part in the order in which a growing one is opened.

    Tables come before the samples, because the writer flushes samples before their trial.
    """
    tables = [
        DataSetSchema(
            table.path,
            1,
            dtype=table.dtype,
            tail=(),
            optional=table is DIGESTS,
            older_dtype=table.older_dtype,
        )
        for table in (*layout.tables, DIGESTS)
    ]
    arrays = [
        DataSetSchema(
            array.path,
            2 if array.per_taxel else 1,
            dtype=np.dtype(f"<{array.type_code}"),
            tail=(n_taxels,) if array.per_taxel else (),
        )
        for array in layout.arrays
    ]
    return (*tables, *arrays, *(text(path) for path, _ in TEXTS))
