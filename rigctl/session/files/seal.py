"""The seal of a model or a file of spikes: a digest of all its bytes, behind the end of HDF5's.

HDF5 ignores what follows the end that its superblock names, and cuts it off where it changes a
file; so the root's attribute ``sealed`` says that there must be one. Older files have neither.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from rigctl.errors import SessionError

_NAME = b"\nrigctl sha256 "
SEAL_BYTES = len(_NAME) + 64 + 1


SEALED = "sealed"


def seal(path: Path) -> None:
    """Append the digest of a closed file. May raise OSError."""
    with path.open("r+b") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        file.write(_NAME + digest.encode() + b"\n")


def check_seal(path: Path, is_sealed: bool) -> None:
    """Raise SessionError where a file that says it is sealed has changed since."""
    if not is_sealed:
        return
    with path.open("rb") as file:
        size = path.stat().st_size - SEAL_BYTES
        file.seek(max(size, 0))
        kept = file.read(SEAL_BYTES)
        file.seek(0)
        total = hashlib.sha256()
        while size > 0 and (block := file.read(min(size, 1 << 20))):
            total.update(block)
            size -= len(block)
    if kept != _NAME + total.hexdigest().encode() + b"\n":
        raise SessionError(
            f"{path} is damaged: its bytes are not those that its digest was made of"
        )
