"""The requests that the engine's socket has not taken yet: a bounded number of them."""

from __future__ import annotations

import socket
from collections import deque
from typing import NamedTuple

MAX_WAITING = 64
"""Requests that wait to be sent: as many as the engine executes for one client at once."""


class _WaitingLine(NamedTuple):
    """One line; ``number``: of its request, None for the token, which always stays."""

    number: int | None
    data: bytes


class Outbox:
    """Sends lines in their order through a non-blocking socket, as far as it takes them."""

    def __init__(self) -> None:
        self._lines: deque[_WaitingLine] = deque()
        self._sent_bytes = 0  # of the first line

    def __len__(self) -> int:
        return len(self._lines)

    @property
    def is_full(self) -> bool:
        """Whether the engine has to read before it gets another request."""
        return len(self._lines) >= MAX_WAITING

    def put(self, data: bytes, number: int | None = None) -> None:
        """Add the line of a request."""
        self._lines.append(_WaitingLine(number, data))

    def drop_requests(self) -> list[int]:
        """Remove the requests of which nothing is sent yet; return their numbers."""
        begun = 1 if self._sent_bytes else 0
        waiting = list(self._lines)[begun:]
        kept = [line for line in waiting if line.number is None]
        self._lines = deque([*list(self._lines)[:begun], *kept])
        return [line.number for line in waiting if line.number is not None]

    def flush(self, connection: socket.socket) -> None:
        """Send what the socket takes now. Raises OSError where the connection is broken."""
        while self._lines:
            data = self._lines[0].data
            try:
                self._sent_bytes += connection.send(memoryview(data)[self._sent_bytes :])
            except BlockingIOError:
                return
            if self._sent_bytes == len(data):
                self._lines.popleft()
                self._sent_bytes = 0
