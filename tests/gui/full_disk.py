"""A disk without room, for this process and its children."""

from __future__ import annotations

import os
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock


@contextmanager
def full_disk(limit_bytes: int) -> Iterator[None]:
    """Let no file of this process and its children grow beyond a limit.

    Python would store compiled modules cut off, and fail at them ever after.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    no_bytecode = mock.patch.object(sys, "dont_write_bytecode", True)
    of_children = mock.patch.dict(os.environ, PYTHONDONTWRITEBYTECODE="1")
    with no_bytecode, of_children:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
