"""An event loop whose clock jumps, a link in memory, and minimal boards that reply on it."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypeVar

from pymodbus.framer import FramerRTU

from rigctl.boards import drum_registers
from rigctl.boards.drum import Drum
from rigctl.boards.drum_codes import CommandResult
from rigctl.boards.drum_registers import pack_value
from rigctl.boards.links import OnBytes, OnLost
from rigctl.errors import LinkLost

Result = TypeVar("Result")
BYTE_S = 10 / drum_registers.BAUD


class _JumpingSelector(selectors.DefaultSelector):
    now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        assert timeout is not None, "the loop would wait forever"
        self.now_s += max(timeout, 0.0)
        return super().select(0)


class JumpingLoop(asyncio.SelectorEventLoop):
    """A loop whose clock jumps to the next timer: no test waits."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        """Seconds since the loop was made."""
        return self._jumping.now_s


def run(main: Callable[[JumpingLoop], Coroutine[Any, Any, Result]]) -> Result:
    """Run ``main`` on a new jumping loop."""
    loop = JumpingLoop()
    asyncio.set_event_loop(loop)
    try:
        return loop.run_until_complete(main(loop))
    finally:
        asyncio.set_event_loop(None)
        loop.close()


class MemoryLink:
    """A cable in memory; ``board`` gets what the host writes, :meth:`say` answers."""

    def __init__(self, loop: JumpingLoop, name: str = "cable") -> None:
        self.name = name
        self.resets_board = False
        self.is_open = False
        self.plugged = True
        self.board: Callable[[bytes], None] = lambda data: None
        self.written: list[bytes] = []
        self.times_opened = 0
        self._loop = loop
        self._on_bytes: OnBytes | None = None
        self._on_lost: OnLost | None = None

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        if not self.plugged:
            raise LinkLost(f"{self.name}: there is no such port")
        self.times_opened += not self.is_open
        self._on_bytes, self._on_lost, self.is_open = on_bytes, on_lost, True

    def write(self, data: bytes) -> None:
        if not self.is_open:
            raise LinkLost(f"{self.name}: the port is closed")
        self.written.append(data)
        self.board(data)

    def close(self) -> None:
        self._on_bytes = self._on_lost = None
        self.is_open = False

    def say(self, data: bytes, after_s: float = 0.0) -> None:
        self._loop.call_later(after_s, self._say, data)

    def unplug(self) -> None:
        self.plugged = False
        on_lost = self._on_lost
        self.close()
        if on_lost is not None:
            on_lost(f"{self.name}: the port vanished")

    def _say(self, data: bytes) -> None:
        if self._on_bytes is not None:
            self._on_bytes(data, self._loop.time())


def rtu(payload: bytes, unit: int = drum_registers.UNIT) -> bytes:
    """One Modbus RTU frame."""
    body = bytes([unit]) + payload
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


class RegisterBoard:
    """A Modbus slave with the drum's registers, without a drum.

    ``refuse``: exception code for every write; ``silent``: no replies; ``garble``: replies whose
    CRC is wrong; ``reply_s``: time until the reply starts.
    """

    def __init__(self, loop: JumpingLoop, link: MemoryLink) -> None:
        self.words = [0] * drum_registers.END
        self.refuse: int | None = None
        self.silent = False
        self.garble = 0
        self.reply_s = 0.001
        self.executed: list[tuple[int, int]] = []
        self._loop = loop
        self._link = link
        link.board = self.receive
        for entry in drum_registers.SETTINGS:
            self.put(entry.name, entry.default)
        for name, value in _IDENTITY.items():
            self.put(name, value)

    def put(self, name: str, *values: int) -> None:
        """Set a register; the state of a real board would."""
        entry = drum_registers.BY_NAME[name]
        for i, value in enumerate(values):
            words = pack_value(entry, value)
            at = entry.address + i * entry.words
            self.words[at : at + entry.words] = words

    def receive(self, request: bytes) -> None:
        """Answer a request; one that a busy computer joined to another has a wrong CRC."""
        is_whole = rtu(request[1:-2]) == request
        if self.silent or not is_whole:
            return
        reply = rtu(self._answer(request[1], request[2:-2]))
        if self.garble:
            self.garble -= 1
            reply = reply[:-1] + bytes([reply[-1] ^ 1])
        self._link.say(reply, self.reply_s + len(reply) * BYTE_S)

    def _answer(self, function: int, data: bytes) -> bytes:
        if function == 3:
            return self._read(function, data)
        if self.refuse is not None:
            return bytes([function | 0x80, self.refuse])
        if function == 16:
            self._write(data)
            return bytes([16]) + data[:4]
        self._write(data[4:])
        return self._read(function, data)

    def _read(self, function: int, data: bytes) -> bytes:
        self.put("board_time_us", round(self._loop.time() * 1e6) % 2**32)
        at, count = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        words = self.words[at : at + count]
        return bytes([function, 2 * count]) + b"".join(w.to_bytes(2, "big") for w in words)

    def _write(self, data: bytes) -> None:
        at = int.from_bytes(data[:2], "big")
        words = [int.from_bytes(data[i : i + 2], "big") for i in range(5, len(data), 2)]
        before = self.words[_SEQUENCE]
        self.words[at : at + len(words)] = words
        self.put("heartbeat_seen", self.words[_HEARTBEAT])
        if self.words[_SEQUENCE] != before:
            self.executed.append((self.words[_SEQUENCE - 1], self.words[_SEQUENCE]))
            self.put("command_acknowledged", self.words[_SEQUENCE])
            self.put("command_result", CommandResult.DONE)


class LoadCellBoard(RegisterBoard):
    """A register board whose load cell converts every 12.4 ms; sample n has raw value 10 n."""

    PERIOD_US = 12_400

    def _read(self, function: int, data: bytes) -> bytes:
        now_us = round(self._loop.time() * 1e6)
        n = now_us // self.PERIOD_US
        self.put("loadcell_sequence", n % 65536)
        self.put("loadcell_time_us", n * self.PERIOD_US % 2**32)
        self.put("loadcell_recent", *(10 * (n - i) for i in range(5)))
        if int.from_bytes(data[:2], "big") >= drum_registers.BY_NAME["ring_raw"].address:
            self._fill_ring(n)
        return super()._read(function, data)

    def _fill_ring(self, newest: int) -> None:
        kept = {n % 64: n for n in range(newest - 63, newest + 1)}
        self.put("ring_raw", *(10 * kept[place] for place in range(64)))
        times_us = (kept[place] * self.PERIOD_US % 2**32 for place in range(64))
        self.put("ring_time_us", *times_us)


class Script:
    """A cable whose other end expects exact bytes: (sent, answered) pairs, in order."""

    def __init__(self, link: MemoryLink, pairs: Sequence[tuple[bytes, bytes]]) -> None:
        self.left = list(pairs)
        self._link = link
        link.board = self.receive

    def receive(self, request: bytes) -> None:
        sent, answered = self.left.pop(0)
        assert request.hex(" ") == sent.hex(" ")
        self._link.say(answered, 0.002)


_SEQUENCE = drum_registers.BY_NAME["command_sequence"].address
_HEARTBEAT = drum_registers.BY_NAME["heartbeat"].address
_IDENTITY = {
    "magic": drum_registers.MAGIC,
    "map_version": drum_registers.MAP_VERSION,
    "board_id": drum_registers.BOARD_DRUM,
    "firmware_version": 0x0103,
    "build_hash": 0x00C0FFEE,
    "boot_count": 41,
    "reset_cause": 1,
    "ring_depth": drum_registers.RING_DEPTH,
    "steps_per_turn": 12800,
    "nm_per_step": 31250,
}


def unconnected_drum(loop: JumpingLoop) -> tuple[Drum, RegisterBoard, MemoryLink]:
    """Return a drum, the board at the other end of its link, and the link."""
    link = MemoryLink(loop, "/dev/drum")
    return Drum(link, loop), RegisterBoard(loop, link), link
