"""Sessions that only the user who records can read."""

from __future__ import annotations

import os
from pathlib import Path

from rigctl.errors import SessionError


def keep_private(folder: Path) -> None:
    """Close a session's folder and files to other users, those included that are made later.

    Everything that this process makes from now on is private: an engine records for one rig.
    Windows keeps a folder's own permissions. Raises SessionError where the folder is another's.
    """
    os.umask(0o077)
    if not folder.is_dir():
        return
    for path in (folder, *folder.iterdir()):
        if path.is_symlink():
            continue
        try:
            path.chmod(0o700 if path.is_dir() else 0o600)
        except OSError as error:
            raise SessionError(
                f"{path} cannot be made private ({error.strerror}): record into a folder of your "
                "own, or set recording.private = false"
            ) from error
