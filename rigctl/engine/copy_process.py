"""A process that copies the finished parts of a run to the second disk, ``recording.copy_to``.

It is ``rigctl copy --follow``: it reads what is recorded and never touches the rig, and a disk that
hangs cannot hold the engine up. It ends by itself when the session is closed and all is copied.
"""

from __future__ import annotations

import asyncio
import subprocess
import threading
from pathlib import Path

from rigctl.engine.told_process import Tell, ToldProcess

COPY = "copy"
"""Kind of the event that the second disk does not have what is finished."""
END_S = 30.0
"""For so long the end of a run waits for its last copies."""


class CopyProcess(ToldProcess):
    """Copies one session."""

    def __init__(self, session: Path, to: str, tell: Tell) -> None:
        self._to = to
        words = ["copy", "--follow", str(session.absolute()), to]
        super().__init__(words, ("log", COPY), tell)

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
