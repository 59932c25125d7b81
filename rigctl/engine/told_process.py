"""A process beside the engine, of which the engine tells what it says.

What must not hold the engine up, a second disk or the Lab Streaming Layer, runs in one. It reads
what is recorded or shown, and never touches the rig.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import IO

from rigctl.engine.rpc.messages import LslScope

Tell = Callable[..., None]
"""Takes the kind of an event, a sentence, and the event's data by name, from any thread."""
RIGCTL = "rigctl: "
"""What a sentence on an error begins with."""
LSL = "lsl"
"""Kind of the events of what is streamed."""


class ToldProcess:
    """A command of rigctl; each line that it prints becomes an event.

    ``kinds``: of the lines of its output, and of its errors. With ``has_input``, :attr:`stdin`
    leads to it. Raises OSError where it cannot start.
    """

    said_by = ""
    """What a line of its errors begins with that is told; a library's own lines do not."""

    def __init__(
        self, words: Sequence[str], kinds: tuple[str, str], tell: Tell, has_input: bool = False
    ) -> None:
        self._tell = tell
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rigctl", *words],
            stdin=subprocess.PIPE if has_input else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        self.stdin = self._process.stdin
        streams = (self._process.stdout, self._process.stderr)
        self._threads = [
            threading.Thread(target=self._read, args=args, name=words[0], daemon=True)
            for args in zip(kinds, streams, ("", self.said_by), strict=True)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def wait(self, limit_s: float | None = None) -> None:
        """Wait until the process has ended and all is told. Raises subprocess.TimeoutExpired."""
        self._process.wait(limit_s)
        for thread in self._threads:
            thread.join()

    def end(self) -> None:
        """End the process, which has nothing to finish."""
        self._process.terminate()
        self.wait()

    def _read(self, kind: str, stream: IO[str], said_by: str) -> None:
        with stream:
            for line in stream:
                if line.startswith(said_by):
                    self._take(kind, line.strip().removeprefix(RIGCTL))
        self._process.wait()  # nobody may wait for one that outlives what it was made for

    def _take(self, kind: str, line: str) -> None:
        """Tell what the process has printed."""
        self._tell(kind, line)


class LslProcess(ToldProcess):
    """A command that uses liblsl, which writes a log of its own among the errors."""

    said_by = RIGCTL


class LslOutlet:
    """What streams the engine over the Lab Streaming Layer, ``rigctl lsl``, while it is on."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._scope = LslScope.OFF
        self._process: LslProcess | None = None

    @property
    def scope(self) -> LslScope:
        """Who can see the streams now; off, too, where the process has ended by itself."""
        is_on = self._process is not None and self._process.is_running
        return self._scope if is_on else LslScope.OFF

    def switch(self, scope: LslScope) -> None:
        """Stream to another circle, or to nobody. Raises OSError where no process can start."""
        if self._process is not None:
            self._process.end()
            self._process = None
        self._scope = scope
        if scope is LslScope.OFF:
            return
        words = ["lsl", "--process", str(os.getpid())]
        words += ["--network"] if scope is LslScope.NETWORK else []
        self._process = LslProcess(words, (LSL, LSL), self._tell)
