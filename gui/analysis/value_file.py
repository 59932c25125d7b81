"""Tables as CSV, and the names of new files. This module does not import Qt."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path
from typing import Any

from rigctl.errors import DiskFault

SIMULATED = "simulated"
"""Name of the column with the origin of the data."""


def new_path(folder: Path, stem: str, suffix: str) -> Path:
    """Return the path of a file that is not there yet, in a folder, which is made.

    Raises DiskFault.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DiskFault(f"{folder} cannot be made ({error}): choose another place") from error
    names = (f"{stem}{f'-{n}' if n > 1 else ''}.{suffix}" for n in count(1))
    return next(folder / name for name in names if not (folder / name).exists())


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


def write_columns(names: Sequence[str], columns: Sequence[Any], path: Path) -> None:
    """Write columns of equal length under their names."""
    write_parts(names, [columns], path)


def write_parts(names: Sequence[str], parts: Iterable[Sequence[Any]], path: Path) -> None:
    """Write columns part after part under their names."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for columns in parts:
            writer.writerows(zip(*(column.tolist() for column in columns), strict=True))


def rows_csv(names: Sequence[str], rows: Any) -> str:
    """Return rows under the names of their columns."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return out.getvalue()
