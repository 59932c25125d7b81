"""Identify the sessions that a model or a file of spikes was made from."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import h5py

from rigctl.errors import SessionError
from rigctl.session.format.annotated_arrays import read_attributes, read_text
from rigctl.session.read.part_file import part_paths

SOURCES_OF_LAYOUT = {"rigctl-model": "training/inputs", "rigctl-spikes": "inputs"}
"""Data set with the source sessions in files of these layouts."""


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
    try:
        with h5py.File(path, "r") as file:
            return read_inputs(file)
    except (OSError, KeyError, ValueError) as error:
        raise SessionError(f"{path} does not list its source sessions: {error}") from error


def read_inputs(file: Any) -> tuple[dict[str, Any], ...]:
    """Return the same from an open file. Raises KeyError or ValueError where there are none."""
    dataset = SOURCES_OF_LAYOUT[str(read_attributes(file).get("layout"))]
    return tuple(json.loads(read_text(file, dataset)))
