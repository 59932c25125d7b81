"""A process that records the streams of other programs beside a session, ``recording.streams``.

It is ``rigctl lsl-inlet``: liblsl finds and takes them there, and nothing of it holds the engine
up. Once a second it is told the session's clock, without waiting for it. When its input ends, it
closes its files and ends.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rigctl.engine.told_process import LslProcess, Tell
from rigctl.session.extra_stream import STREAM_KIND

CLOCK_PERIOD_S = 1.0
END_S = 10.0
"""For so long the end of a run waits until the streams are closed."""


class StreamsProcess(LslProcess):
    """Records the ``wanted`` streams beside one sitting, which began at ``start``.

    ``closed``: the last digest of each file that is closed, by its name.
    """

    def __init__(
        self, folder: Path, wanted: Sequence[str], start: tuple[str, float], tell: Tell
    ) -> None:
        self.closed: dict[str, str] = {}
        self._told_s = -CLOCK_PERIOD_S
        begun = [f"--start-utc={start[0]}", f"--start-loop-s={start[1]!r}"]
        asked = [f"--stream={words}" for words in wanted]
        words = ["lsl-inlet", str(folder.absolute()), *begun, *asked]
        super().__init__(words, (STREAM_KIND, STREAM_KIND), tell, has_input=True)
        assert self.stdin is not None
        self._input = self.stdin.fileno()
        if os.name == "posix":
            os.set_blocking(self._input, False)

    def tell_time(self, loop_s: float) -> None:
        """Tell it the session's clock, at most once a second; it may miss one, and never blocks."""
        if loop_s - self._told_s < CLOCK_PERIOD_S or self.stdin is None or self.stdin.closed:
            return
        self._told_s = loop_s
        with suppress(OSError):  # it is busy, or has ended and said why
            os.write(self._input, f"{loop_s!r}\n".encode())

    def let_go(self) -> None:
        """Let it close its files and end by itself; it tells no more."""
        self._tell = lambda kind, text, **data: None
        self._end_input()

    async def finish(self) -> dict[str, str]:
        """Wait until its files are closed; return the last digest of each by its name."""
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()

        def wait() -> None:
            self._end_input()
            try:
                self.wait(END_S)
            except subprocess.TimeoutExpired:
                self._tell(STREAM_KIND, "the streams beside the session were not closed in time")
                self.end()
            loop.call_soon_threadsafe(ended.set)

        thread = threading.Thread(target=wait, name="streams")
        thread.start()
        await ended.wait()
        thread.join()
        return self.closed

    def _end_input(self) -> None:
        if self.stdin is not None:
            with suppress(OSError):
                self.stdin.close()

    def _take(self, kind: str, line: str) -> None:
        """Tell a sentence, or keep the digest of a file that is closed."""
        if not line.startswith("{"):
            return self._tell(kind, line)
        self.closed |= json.loads(line)
        return None
