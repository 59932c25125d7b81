"""Questions at a terminal, and signals that end a command at a safe place."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any

from rigctl.config.visible_text import visible
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
