"""Standard output and error of a command: every terminal can show them, and none acts on them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO, cast

from rigctl.config.text_file import UNENCODABLE, visible
from rigctl.errors import DiskFault

_REDRAW = "\r"
"""What a progress line writes before it draws itself again; within a text it is escaped."""


class VisibleOutput:
    """Text stream in front of another; escapes what acts on a terminal or cannot be encoded.

    What cannot be written raises BrokenPipeError where the reader has gone, else DiskFault. A
    stream that ``may_fail`` drops it instead: nobody reads the messages, the work goes on.
    """

    errors = UNENCODABLE

    def __init__(self, target: TextIO, may_fail: bool = False) -> None:
        self._target = target
        self._may_fail = may_fail
        self._lost = False

    def __getattr__(self, name: str) -> Any:
        """Return what the stream behind has, such as ``isatty`` and ``fileno``."""
        return getattr(self._target, name)

    def write(self, text: str) -> int:
        """Write the visible text; return the number of letters of ``text``."""
        shown = text if text == _REDRAW else visible(text, self._target.encoding or "utf-8")
        if not self._lost:
            try:
                self._target.write(shown)
            except OSError as error:
                self._lose(error)
        return len(text)

    def flush(self) -> None:
        """Write what is still buffered."""
        if not self._lost:
            try:
                self._target.flush()
            except OSError as error:
                self._lose(error)

    def _lose(self, error: OSError) -> None:
        self._lost = True
        _discard(self._target)
        if self._may_fail:
            return
        if isinstance(error, BrokenPipeError):
            raise error
        raise DiskFault(f"the output cannot be written ({error.strerror})") from error


@contextmanager
def visible_output() -> Iterator[None]:
    """Put a :class:`VisibleOutput` in front of standard output and error while entered."""
    _open_closed()
    # Else numba lets colorama write its colours' reset at the end, which would be shown escaped.
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    plain = sys.stdout, sys.stderr
    sys.stdout = cast(TextIO, VisibleOutput(plain[0]))
    sys.stderr = cast(TextIO, VisibleOutput(plain[1], may_fail=True))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = plain


def _open_closed() -> None:
    """Open streams that were closed before the start, as ``>&-`` does, to nowhere.

    Otherwise the next file would take their number, and libraries would write messages into it.
    """
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8"))


def _discard(stream: TextIO) -> None:
    """Lead a stream to nowhere: Python's flush at exit would fail once more."""
    # A stream without a file, as tests have, needs none.
    with suppress(OSError, ValueError):
        number = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)
