"""The interface of a link to a board: bytes both ways, and a report when it is lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

OnBytes = Callable[[bytes, float], None]
"""Called in the loop's thread with bytes and the loop time of their arrival."""
OnLost = Callable[[str], None]
"""Called in the loop's thread, once, with a sentence: the port vanished."""


class ByteLink(Protocol):
    """A serial port, a socket or a simulated cable. All calls come from the loop's thread."""

    name: str
    resets_board: bool
    """Whether opening it resets the board, as a serial port does most Arduinos."""

    @property
    def is_open(self) -> bool:
        """True from a successful :meth:`open` until the link is closed or lost."""
        ...

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Open the port and start reading; its owner may open it again, which changes nothing.

        Raises LinkLost with one sentence.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send bytes. Raises LinkLost where the link is not open."""
        ...

    def close(self) -> None:
        """Stop reading and free the port; closing twice is harmless."""
        ...
