"""Ctrl-C for work that ends at its next good place."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any


class Interrupt:
    """While entered, Ctrl-C and a polite kill are noted; a second one acts as ever."""

    def __init__(self) -> None:
        self._before: dict[int, Any] = {}
        self._asked = False

    def asked(self) -> bool:
        """Whether somebody wants it to end."""
        return self._asked

    def __enter__(self) -> Interrupt:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._caught)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _caught(self, number: int, frame: FrameType | None) -> None:
        self._asked = True
        signal.signal(number, self._before[number])
