"""Refuse paths that are no plain files before HDF5 opens them."""

from __future__ import annotations

import os
from pathlib import Path

from rigctl.config.text_file import open_file
from rigctl.errors import SessionError


def plain_file_size(path: Path) -> int:
    """Return the size of a plain file in bytes; links are followed.

    Raises SessionError for a missing file, a pipe, a device, a folder, and a name that no file can
    have. HDF5 itself would wait for a pipe's writer.
    """
    with open_file(path, SessionError) as file:
        return os.fstat(file.fileno()).st_size
