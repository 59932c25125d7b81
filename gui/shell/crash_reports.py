"""Errors that nobody expected: a sentence in the window, and one file with all that helps."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QObject, Signal

from gui.shell.help_page import version_lines

REPORTS = "crash-reports"
"""Folder of the reports, beside the settings."""
MAX_REPORTS = 20
"""In a sitting: an error in a timer repeats thirty times a second."""


class CrashReporter(QObject):
    """Writes a file for each unexpected error of this process, in any of its threads.

    ``read_log`` returns the event log, which becomes a part of the file.
    """

    reported = Signal(str, str)
    """Kind and sentence for the event log; Qt passes them to the window's thread."""

    def __init__(self, folder: Path, read_log: Callable[[], str]) -> None:
        super().__init__()
        self._folder, self._read_log = folder, read_log
        self._seen: set[str] = set()

    def install(self) -> None:
        """Take the errors that Python would print, of slots and of threads."""
        sys.excepthook = self.take
        threading.excepthook = self._take_of_thread

    def remove(self) -> None:
        """Leave the errors to Python again."""
        sys.excepthook = sys.__excepthook__
        threading.excepthook = threading.__excepthook__

    def take(
        self, kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        """Write the report of an error and tell where it is; the same error only once."""
        lines = "".join(traceback.format_exception(kind, error, trace))
        print(lines, file=sys.stderr)
        if lines in self._seen or len(self._seen) >= MAX_REPORTS:
            return
        self._seen.add(lines)
        self.reported.emit("failed", self._sentence(lines))

    def _take_of_thread(self, args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            self.take(args.exc_type, args.exc_value, args.exc_traceback)

    def _sentence(self, lines: str) -> str:
        try:
            path = self._write(lines)
        except OSError as error:
            return f"something in the window failed, and its report could not be written ({error})"
        return (
            f"something in the window failed; please send its report to who looks after it: {path}"
        )

    def _write(self, lines: str) -> Path:
        self._folder.mkdir(parents=True, exist_ok=True)
        now = datetime.now().astimezone()
        path = self._folder / f"rigctl-crash-{now:%Y%m%d-%H%M%S}-{len(self._seen)}.txt"
        log = self._read_log() if threading.current_thread() is threading.main_thread() else ""
        parts = (now.isoformat(), "\n".join(version_lines()), lines, "Event log:", log)
        with path.open("x", encoding="utf-8") as file:
            file.write("\n\n".join(parts))
        return path
