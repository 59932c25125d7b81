"""A disk that is slow for the Qt thread only: every file of the user takes its time."""

from __future__ import annotations

import builtins
import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

DELAY_S = 0.15
_CALLS: tuple[tuple[Any, str], ...] = (
    (builtins, "open"),
    (io, "open"),
    (os, "stat"),
    (os, "listdir"),
    (os, "scandir"),
    (os, "mkdir"),
    (os, "replace"),
)


@contextmanager
def slow_disk(folder: str) -> Iterator[None]:
    """Delay the calls of this thread for paths below a folder; other threads are as quick."""
    thread = threading.get_ident()

    def slow(call: Callable[..., Any]) -> Callable[..., Any]:
        def delayed(*args: Any, **named: Any) -> Any:
            path = args[0] if args else ""
            is_path = isinstance(path, str | os.PathLike)
            if threading.get_ident() == thread and is_path and os.fspath(path).startswith(folder):
                time.sleep(DELAY_S)
            return call(*args, **named)

        return delayed

    with ExitStack() as stack:
        for module, name in _CALLS:
            stack.enter_context(mock.patch.object(module, name, slow(getattr(module, name))))
        yield
