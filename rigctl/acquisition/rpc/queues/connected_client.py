"""One client of the engine, and what is queued for it: a bounded number of bytes of each kind."""

from __future__ import annotations

import asyncio
import socket
from contextlib import suppress
from typing import Any

from rigctl.acquisition.rpc.messages import DISCONNECTED, encode_message, engine_message

STATUS_LIMIT_BYTES = 1 << 17
"""With more unread a client gets no status, which soon comes again."""
UNREAD_LIMIT_BYTES = 1 << 21
"""Events and replies are never left out: with more unread the engine disconnects the client."""
DISCONNECTED_CLIENT = "the engine has disconnected this client"
CAUGHT_UP_BYTES = 1 << 16
TELL_EVERY_S = 10.0
LINGER_S = 5.0
"""A client that is disconnected may read the reason for so long."""
MAX_UNDER_WAY = 64
"""Requests of one client that the engine executes at once; STOP is one more, always."""


class ConnectedClient:
    """One client that the door let in. ``number``: its own, never given again; ``name``: or empty.

    It takes what is sent in its own time; nothing here waits for it.
    """

    def __init__(
        self,
        number: int,
        writer: asyncio.StreamWriter,
        spare: socket.socket | None = None,
        name: str = "",
    ) -> None:
        """Take a connection; ``spare``: a duplicate of its socket, which this object closes."""
        self.number, self.name = number, name
        self._spare = spare
        self.under_way = 0
        self.only_stops = self._has_asked = False
        self._writer = writer
        self._left_out = {"statuses": 0}
        self._told_s: float | None = None
        self._dropped_s: float | None = None

    def note_request(self, command: str) -> None:
        """Take note of a request; ``only_stops``: whether all of them were STOP."""
        self.only_stops = command == "stop" and (self.only_stops or not self._has_asked)
        self._has_asked = True

    @property
    def unread_bytes(self) -> int:
        """Bytes that the client has not read yet."""
        return int(self._writer.transport.get_write_buffer_size())

    @property
    def is_dropped(self) -> bool:
        """Whether the engine has disconnected it."""
        return self._dropped_s is not None

    def send(self, line: bytes) -> None:
        """Send an event or a reply. What is too much is dropped with the client: see ``tend``."""
        if not self._writer.is_closing() and self.unread_bytes <= UNREAD_LIMIT_BYTES:
            self._writer.write(line)

    def send_status(self, line: bytes) -> None:
        """Send a status, or leave it out where the client is behind: a newer one comes soon."""
        if self.unread_bytes > STATUS_LIMIT_BYTES:
            self._left_out["statuses"] += 1
        else:
            self.send(line)

    def tend(self, now_s: float) -> bool:
        """Tell what was left out once the client has caught up; ``now_s``: loop time.

        Returns whether it is hopeless: events are lost to it. Then it gets the reason and some time
        to read it, and no more.
        """
        if self._dropped_s is not None:
            if now_s - self._dropped_s > LINGER_S:
                self._writer.transport.abort()
        elif self.unread_bytes > UNREAD_LIMIT_BYTES:
            self._drop(now_s)
            return True
        elif any(self._left_out.values()) and self._may_tell(now_s):
            self._told_s = now_s
            self.send(encode_message(engine_message("left_out", self._words(), self._left_out)))
            self._left_out = dict.fromkeys(self._left_out, 0)
        return False

    def unread_lines(self) -> list[bytes]:
        """Return what the client had sent, and nobody has read, when writing to it failed.

        asyncio forgets that; the duplicate of the socket still has it.
        """
        data = bytearray()
        with suppress(OSError):
            while self._spare and len(data) < UNREAD_LIMIT_BYTES:
                if not (received := self._spare.recv(1 << 16)):
                    break
                data += received
        return bytes(data).splitlines()

    def close(self) -> None:
        """Close the connection."""
        self._writer.close()
        if self._spare is not None:
            self._spare.close()

    def abort_unread(self) -> None:
        """Close the connection of a client that has left something unread until now."""
        if self.unread_bytes:
            self._writer.transport.abort()

    def _may_tell(self, now_s: float) -> bool:
        is_time = self._told_s is None or now_s - self._told_s >= TELL_EVERY_S
        return is_time and self.unread_bytes <= CAUGHT_UP_BYTES

    def _drop(self, now_s: float) -> None:
        self._dropped_s = now_s
        text = (
            f"{DISCONNECTED_CLIENT}, which left {UNREAD_LIMIT_BYTES >> 20} MiB "
            "unread: join it again; a run goes on, and its session has everything"
        )
        data: dict[str, Any] = {"unread_bytes": self.unread_bytes}
        self._writer.write(encode_message(engine_message(DISCONNECTED, text, data)))
        self._writer.close()

    def _words(self) -> str:
        return (
            f"this client was behind: {self._left_out['statuses']} statuses were left out for it; "
            "no event is missing"
        )
