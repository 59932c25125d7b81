"""The sample session: a virtual data set in the user's data folder, to look at without recording.

The command ``rigctl synth`` makes it, in a process of its own. It appears whole or not at all, and
is used again as long as ``rigctl verify`` finds it whole.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import platformdirs

from rigctl.analysis.files import PARTIAL, atomic_directory
from rigctl.errors import DiskFault, SessionError
from rigctl.session.writer_lock import WriterLock, is_being_written

NAME = "sample-session"
SYNTH = ("synth", "--plan", "quick", "--seed", "1")
CHECKING, MAKING = "Checking the sample session", "Making the sample session"
_ANSWERED = (0, 1, 2)
"""Exit codes of a check that came to an end."""


def sample_folder() -> Path:
    """Return where the sample session stands: below $XDG_DATA_HOME or ~/.local/share on Linux."""
    return Path(platformdirs.user_data_path("rigctl", appauthor=False)) / "sample" / NAME


class SampleSession:
    """The sample session in ``folder``; :meth:`provide` works in one thread, others may cancel it.

    ``told`` gets the present stage and the last line that its command printed, empty at first.
    """

    def __init__(self, folder: Path, told: Callable[[str, str], None]) -> None:
        self.folder, self._told = folder, told
        self.remark = ""
        """What happened to a damaged one, empty without one."""
        self._guard = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._is_cancelled = False

    def provide(self) -> bool:
        """Make the session unless there is a whole one; return False if that was cancelled.

        Raises SessionError with the last line of a command that failed, or while another process
        makes the session, and DiskFault where the folder cannot be written.
        """
        try:
            with _locked(self.folder.parent):
                if not self._is_whole():
                    self._set_aside()
                    self._make()
        except _Cancelled:
            return False
        except OSError as error:
            why = error.strerror or error
            raise DiskFault(
                f"{self.folder} cannot be written ({why}): make room there, or allow writing"
            ) from error
        return True

    def cancel(self) -> None:
        """End the command that runs; :meth:`provide` then removes what it has made."""
        with self._guard:
            self._is_cancelled = True
            if self._process is not None:
                self._process.kill()

    def _is_whole(self) -> bool:
        """Return whether there is a whole session. Raises SessionError if nobody can say."""
        if not os.path.lexists(self.folder):
            return False
        code, line = self._run(CHECKING, "verify", str(self.folder))
        if code not in _ANSWERED:
            raise SessionError(f"{self.folder} cannot be checked: {line}")
        return code == 0

    def _set_aside(self) -> None:
        """Rename what is in the place of the session: it may hold notes of the user."""
        if not os.path.lexists(self.folder):
            return
        names = (f"{NAME}-damaged-{number}" for number in count(1))
        aside = next(path for name in names if not (path := self.folder.with_name(name)).exists())
        self.folder.rename(aside)
        self.remark = (
            f"{self.folder} is damaged: it is now {aside.name} and a new one is made "
            "(rigctl verify names the damage)"
        )

    def _make(self) -> None:
        remnant = self.folder.with_name(PARTIAL.format(name=self.folder.name))
        if is_being_written(remnant):  # by a command whose window was killed
            raise SessionError("another process makes it: try again in a minute")
        shutil.rmtree(remnant, ignore_errors=True)
        with atomic_directory(self.folder) as partial:
            code, line = self._run(MAKING, *SYNTH, "--out", str(partial))
            if code:
                raise SessionError(line)

    def _run(self, stage: str, *words: str) -> tuple[int, str]:
        """Run a command of rigctl, and return its exit code and the last line of its errors."""
        with self._guard:
            if self._is_cancelled:
                raise _Cancelled
            self._process = process = _start(words)
        line = unexplained = f"rigctl {words[0]} ended unexpectedly"
        self._told(stage, "")
        assert process.stderr is not None
        with process:
            for text in process.stderr:
                line = text.strip().removeprefix("rigctl: ") or line
                self._told(stage, line)
        if self._is_cancelled:
            raise _Cancelled
        return process.returncode, line if process.returncode > 0 else unexplained


class _Cancelled(Exception):
    """Somebody has called :meth:`SampleSession.cancel`."""


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which is made. Raises SessionError while another window does."""
    folder.mkdir(parents=True, exist_ok=True)
    if is_being_written(folder):
        raise SessionError("another window makes it: wait until that is done, then try again")
    lock = WriterLock(folder)
    try:
        yield
    finally:
        lock.release()


def _start(words: tuple[str, ...]) -> subprocess.Popen[str]:
    """Start a command of rigctl, whose errors and progress can be read."""
    return subprocess.Popen(
        [sys.executable, "-m", "rigctl", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )
