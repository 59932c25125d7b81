"""Write numbers as CSV. This module does not import Qt."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigctl.errors import DiskFault


def save_values(path: Path, names: Sequence[str], columns: Sequence[Any]) -> None:
    """Write columns of equal length under their names; a new file. Raises DiskFault."""
    rows = zip(*(column.tolist() for column in columns), strict=True)
    try:
        with path.open("x", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            writer.writerows(rows)
    except OSError as error:
        raise DiskFault(f"{path} cannot be written ({error}): free some space") from error
