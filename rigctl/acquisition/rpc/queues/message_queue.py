"""The messages that have arrived and that nobody has taken yet: a bounded number of them."""

from __future__ import annotations

from collections import deque
from typing import Any

from rigctl.acquisition.rpc.messages import engine_message

KEPT_MESSAGES = 5_000
"""Of events and replies. Of statuses only the newest counts."""


class MessageQueue:
    """Keeps messages in their order; tells how many it has left out because nobody took them.

    A status replaces an older one. Of too many messages the oldest are left out.
    """

    def __init__(self) -> None:
        self._messages: deque[dict[str, Any]] = deque()
        self._status: dict[str, Any] | None = None
        self._left_out = 0

    def __len__(self) -> int:
        return len(self._messages)

    def __iter__(self) -> Any:
        return iter(self._messages)

    def put(self, message: dict[str, Any]) -> None:
        """Add a message."""
        if message.get("event") == "status":
            self._drop_status()
            self._status = message
        elif len(self._messages) >= KEPT_MESSAGES:
            self._left_out += self._messages.popleft() is not self._status
        self._messages.append(message)

    def take(self) -> list[dict[str, Any]]:
        """Return all messages, the oldest first; the first one tells what was left out."""
        taken = list(self._messages)
        self._messages.clear()
        self._status = None
        if self._left_out:
            text = (
                f"{self._left_out} messages of the engine came while this program was busy and are "
                "left out: the session and the engine's history have what they told"
            )
            taken.insert(0, engine_message("left_out", text, {"messages": self._left_out}))
            self._left_out = 0
        return taken

    def _drop_status(self) -> None:
        """Remove the status that a new one replaces; it is near the end, if it is there."""
        if self._status is None:
            return
        for index in range(len(self._messages) - 1, -1, -1):
            if self._messages[index] is self._status:
                del self._messages[index]
                return
