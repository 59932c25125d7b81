"""What a session is by its content: a digest that does not depend on where it lies."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.read.folder import part_paths


def content_of(folder: Path) -> str:
    """SHA-256 over the SHA-256 of each part's bytes, in order, as ``sha256sum`` prints them.

    A part is never written again once it is closed, so equal recordings have equal digests.
    Raises SessionError for a folder that is no session or cannot be read.
    """
    whole = hashlib.sha256()
    for path in part_paths(folder):
        try:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise SessionError(f"{path} cannot be read: {error.strerror or error}") from error
        whole.update(digest.encode())
    return whole.hexdigest()
