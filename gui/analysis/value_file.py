"""Write pictures and tables as new files, whole or not at all. This module does not import Qt."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

from rigctl.analysis.files import atomic_file
from rigctl.errors import DiskFault

SIMULATED = "simulated"
"""Name of the column with the origin of the data."""


def save_new(folder: Path, stem: str, suffix: str, content: bytes) -> Path:
    """Write a new file into a folder, which is made; no file is ever overwritten.

    Raises DiskFault; then there is no file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DiskFault(f"{folder} cannot be made ({error}): choose another place") from error
    names = (f"{stem}{f'-{n}' if n > 1 else ''}.{suffix}" for n in count(1))
    path = next(folder / name for name in names if not (folder / name).exists())
    with atomic_file(path) as partial:
        partial.write_bytes(content)
    return path


def data_words(*, simulated: bool) -> str:
    """Return where data come from, as every page and figure says it."""
    return "SIMULATED data" if simulated else "Recorded data"


def yes_or_no(simulated: bool) -> str:
    """Return what the column :data:`SIMULATED` says."""
    return "yes" if simulated else "no"


def with_origin(text: str, *, simulated: bool) -> str:
    """Return a CSV with a column that says in each row whether its data are simulated.

    One that has such a column stays as it is, and so do comments above the names.
    """
    lines = text.splitlines(keepends=True)
    n_comments = next((n for n, line in enumerate(lines) if not line.startswith("#")), len(lines))
    names, *rows = csv.reader(io.StringIO("".join(lines[n_comments:])))
    if SIMULATED in names:
        return text
    said = yes_or_no(simulated)
    table = rows_csv((*names, SIMULATED), ((*row, said) for row in rows))
    return "".join(lines[:n_comments]) + table


def columns_csv(names: Sequence[str], columns: Sequence[Any]) -> bytes:
    """Return columns of equal length under their names."""
    return rows_csv(names, zip(*(column.tolist() for column in columns), strict=True)).encode()


def rows_csv(names: Sequence[str], rows: Any) -> str:
    """Return rows under the names of their columns."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return out.getvalue()
