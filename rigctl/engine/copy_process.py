"""A process that copies the finished parts of a run to the second disk, ``recording.copy_to``.

It is ``rigctl copy --follow``: it reads what is recorded and never touches the rig, and a disk that
hangs cannot hold the engine up. It ends by itself when the session is closed and all is copied.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO

COPY = "copy"
"""Kind of the event that the second disk does not have what is finished."""
END_S = 30.0
"""For so long the end of a run waits for its last copies."""


class CopyProcess:
    """Copies one session. ``tell`` takes the kind of an event and a sentence, from any thread."""

    def __init__(self, session: Path, to: str, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._to = to
        words = [sys.executable, "-m", "rigctl", "copy", "--follow", str(session.absolute()), to]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=pipe,
            stderr=pipe,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        self._threads = [
            threading.Thread(target=self._read, args=(kind, stream), name="copy", daemon=True)
            for kind, stream in (("log", self._process.stdout), (COPY, self._process.stderr))
        ]
        for thread in self._threads:
            thread.start()

    def wait(self, limit_s: float | None = None) -> None:
        """Wait until the process has ended and all is told. Raises subprocess.TimeoutExpired."""
        self._process.wait(limit_s)
        for thread in self._threads:
            thread.join()

    async def finish(self) -> None:
        """Wait until all of the closed session is copied; one that takes long goes on alone."""
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()

        def wait() -> None:
            try:
                self.wait(END_S)
            except subprocess.TimeoutExpired:
                self._tell(COPY, f"the copy to {self._to} takes longer and goes on after the run")
                self._tell = lambda kind, text: None  # the engine may end before it
            loop.call_soon_threadsafe(ended.set)

        thread = threading.Thread(target=wait, name="copy")
        thread.start()
        await ended.wait()
        thread.join()

    def _read(self, kind: str, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                self._tell(kind, line.strip().removeprefix("rigctl: "))
