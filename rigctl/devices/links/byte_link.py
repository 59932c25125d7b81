"""What a board hangs on: something that carries bytes both ways and can be lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rigctl.errors import LinkLost

OnBytes = Callable[[bytes, float], None]
"""Called in the loop's thread with bytes and the loop time at which they arrived."""
OnLost = Callable[[str], None]
"""Called in the loop's thread, once, with a sentence: the port vanished."""


class ByteLink(Protocol):
    """A serial port, a socket or a simulated cable. All calls belong to the loop's thread."""

    name: str

    @property
    def is_open(self) -> bool:
        """True from a successful :meth:`open` until it is closed or lost."""
        ...

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Begin to listen. Raises LinkLost with one sentence where that is impossible."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes. Raises LinkLost where the link is not open."""
        ...

    def close(self) -> None:
        """Stop listening and free the port; harmless when closed already."""
        ...


class BoardRebooted(LinkLost):
    """The board started anew by itself: its settings are the defaults again, connect anew."""
