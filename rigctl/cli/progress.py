"""A line that shows the progress of a command and the remaining time."""

from __future__ import annotations

import shutil
import signal
import time
from collections import deque
from types import FrameType
from typing import Any, TextIO

from rigctl.config.text_file import visible
from rigctl.errors import WrongUse


class Interrupts:
    """Counts SIGINT and SIGTERM while entered; those after the ``limit``-th act as usual."""

    def __init__(self, limit: int | None = None) -> None:
        self.count = 0
        self._limit = limit
        self._handlers: dict[int, Any] = {}

    def requested(self) -> bool:
        """Return whether a signal has requested the end of the work."""
        return self.count > 0

    def __enter__(self) -> Interrupts:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._handlers[number] = signal.signal(number, self._count_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _count_signal(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        if self.count == self._limit:
            self.__exit__()


def ask(text: str, remedy: str) -> None:
    """Print ``text`` and wait for Enter.

    Raises KeyboardInterrupt for the answer a, and WrongUse with ``remedy`` without a terminal.
    """
    try:
        answer = input(visible(f"{text} [Enter, or a to abort] "))
    except EOFError:
        raise WrongUse(f"there is no terminal to answer at: {remedy}") from None
    if answer.strip().lower().startswith("a"):
        raise KeyboardInterrupt


LINE_EVERY_S = 5.0
REDRAW_EVERY_S = 0.1
PACE_S = 30.0


class ProgressLine:
    """A line that is redrawn on a terminal, and printed every few seconds elsewhere.

    ``quiet`` prints nothing at all.
    """

    def __init__(self, out: TextIO, quiet: bool = False) -> None:
        self._out = out
        self._quiet = quiet
        self._redraws = out.isatty()
        self._stage: str | None = None
        self._began_s = time.monotonic()
        self._shown_s = float("-inf")
        self._width = 0

    @property
    def elapsed_s(self) -> float:
        """Wall time since the line or its present stage began."""
        return time.monotonic() - self._began_s

    def show(self, text: str, last: bool = False) -> None:
        """Show a text if it is time to, or if it is the ``last`` of its stage."""
        now_s = time.monotonic()
        period_s = REDRAW_EVERY_S if self._redraws else LINE_EVERY_S
        if self._quiet or (now_s - self._shown_s < period_s and not (last and self._redraws)):
            return
        self._shown_s = now_s
        if self._redraws:  # a line that the terminal breaks in two cannot be drawn again
            text = text[: shutil.get_terminal_size().columns - 1]
        self._write(text, "" if self._redraws else "\n")

    def show_stage(self, stage: str, done: int, total: int) -> None:
        """Show the progress of a stage and the remaining time; a new stage appears immediately."""
        if stage != self._stage:
            self.end()
            self._stage, self._began_s, self._shown_s = stage, time.monotonic(), float("-inf")
        left = f", {remaining(self.elapsed_s, done / total)} left" if 0 < done < total else ""
        self.show(f"{stage}: {done} of {total}{left}", last=done >= total)

    def show_share(self, stage: str, share: float) -> None:
        """Show the share of a stage that is done, 0 to 1; a new stage appears immediately."""
        if stage != self._stage:
            self.end()
            self._stage, self._began_s, self._shown_s = stage, time.monotonic(), float("-inf")
        self.show(f"{stage}: {share:.0%}" if 0 < share < 1 else stage, last=share >= 1)

    def say(self, sentence: str) -> None:
        """Print a sentence that stays."""
        if not self._quiet:
            self._write(sentence, "\n")

    def end(self) -> None:
        """Leave the line as it is and begin a new one."""
        if self._width:
            self._out.write("\n")
            self._width = 0

    def _write(self, text: str, end: str) -> None:
        if self._redraws:
            self._out.write("\r")  # by itself, as VisibleOutput lets it pass
        self._out.write(f"{text}{' ' * (self._width - len(text))}{end}")
        self._out.flush()
        self._width = 0 if end else len(text)


class Pace:
    """The pace of the last half minute.

    The first report only begins it: until then compilers run, files open, and what an earlier run
    has done is skipped.
    """

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque()

    def add(self, now_s: float, done: float) -> float:
        """Take what is done at this time; return the work per second, 0 while it is unknown."""
        self._points.append((now_s, done))
        while len(self._points) > 2 and now_s - self._points[0][0] > PACE_S:
            self._points.popleft()
        first_s, first_done = self._points[0]
        return (done - first_done) / (now_s - first_s) if now_s > first_s else 0.0


def remaining(elapsed_s: float, share: float) -> str:
    """Return the time left after ``share`` of the work took ``elapsed_s``."""
    return clock(elapsed_s * (1.0 - share) / share)


def clock(seconds: float) -> str:
    """Return hours, minutes and seconds: 1:02:03."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02}"
