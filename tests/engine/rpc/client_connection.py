"""A client of an engine in the test's own process, one request after the other."""

from __future__ import annotations

import asyncio
from typing import Any, Self

from rigctl.engine.rpc.messages import decode_message, encode_message


class ClientConnection:
    """Sends requests, and keeps the events that come between the replies."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.events: list[dict[str, Any]] = []
        self._reader, self._writer = reader, writer
        self._number = 0

    @classmethod
    async def connect(cls, address: tuple[str, int], name: str = "") -> Self:
        """Connect with the token of the harness; tell a name if there is one."""
        client = cls(*await asyncio.open_connection(*address, limit=1 << 20))
        client._writer.write(encode_message({"token": "token"}))
        if name:
            await client.request("introduce", name=name)
        return client

    async def ask(self, command: str, **args: Any) -> dict[str, Any]:
        """Send a request and return its reply, a refusal too."""
        self._number += 1
        request = {"id": self._number, "command": command, "args": args}
        self._writer.write(encode_message(request))
        while (message := await self.read()).get("reply") != self._number:
            self.events.append(message)
        return message

    async def request(self, command: str, **args: Any) -> dict[str, Any]:
        """Send a request that the engine does not refuse, and return its result."""
        reply = await self.ask(command, **args)
        assert reply["ok"], reply
        return dict(reply["result"])

    async def refusal(self, command: str, **args: Any) -> str:
        """Send a request that the engine refuses, and return its sentence."""
        reply = await self.ask(command, **args)
        assert not reply["ok"] and reply["exit_code"] == 2, reply
        return str(reply["error"])

    async def read(self) -> dict[str, Any]:
        """Return the next message."""
        line = await self._reader.readline()
        assert line, "the engine has closed the connection"
        return decode_message(line)

    async def until(self, kind: str) -> dict[str, Any]:
        """Return the next event of a kind, one that came between replies first."""
        while True:
            message = self.events.pop(0) if self.events else await self.read()
            if message.get("event") == kind:
                return message

    async def close(self) -> None:
        """Leave."""
        self._writer.close()
        await self._writer.wait_closed()
