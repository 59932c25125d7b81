"""Identify the sessions that a model or a file of spikes was made from."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.files.analysis_file import open_analysis_file
from rigctl.session.format.annotated_arrays import read_text
from rigctl.session.read.part_file import part_paths


def content_digest(folder: Path) -> str:
    """Return the SHA-256 of the hexadecimal SHA-256 of each part's bytes, in order.

    The writer never changes a closed part, so equal recordings have equal digests wherever they
    are stored. Raises SessionError for another kind of folder or one that it cannot read.
    """
    total = hashlib.sha256()
    for path in part_paths(folder):
        try:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise SessionError(f"{path} cannot be read: {error.strerror or error}") from error
        total.update(digest.encode())
    return total.hexdigest()


def load_inputs(path: Path) -> tuple[dict[str, Any], ...]:
    """Return a mapping for each source session. Raises SessionError for a damaged or other file."""
    with open_analysis_file(path, "give one that rigctl made") as file:
        return read_inputs(file)


def read_inputs(file: Any) -> tuple[dict[str, Any], ...]:
    """Return the same from an open file. Raises KeyError or ValueError where there are none."""
    dataset = "training/inputs" if "training" in file else "inputs"
    return tuple(json.loads(read_text(file, dataset)))
