"""A tracker that sends datagrams of ``sequence,time_ms,x,y,z``, from this computer by default."""

from __future__ import annotations

import asyncio
import socket

from rigctl.devices.trackers.source_clock import SourceClock
from rigctl.devices.trackers.streaming_tracker import StreamingTracker
from rigctl.errors import LinkLost
from rigctl.values import Position
from rigctl.wire.tracker_lines import decode_datagram

LOOPBACK = "127.0.0.1"
READ_SIZE = 2048
AT_ONCE = 64
"""Datagrams read in a row: a flood cannot keep the loop from its other work."""


class UdpTracker(StreamingTracker):
    """Positions in mm from datagrams to a port of this computer.

    It listens on loopback and takes datagrams of ``sender`` only; others are counted as foreign.
    To listen to another computer, ``host`` is this computer's address and ``sender`` the other's.
    Port 0 takes a free one: see ``port`` after opening. Needs a selector loop.
    """

    def __init__(
        self,
        port: int,
        loop: asyncio.AbstractEventLoop,
        latency_s: float = 0.0,
        host: str = LOOPBACK,
        sender: str = LOOPBACK,
    ) -> None:
        super().__init__(f"tracker udp:{port}", loop)
        self.port = port
        self._address = (host, port)
        self._sender = sender
        self._latency_s = latency_s
        self._socket: socket.socket | None = None
        self._clock = SourceClock(latency_s)
        self._last_sequence: int | None = None

    def _begin(self) -> None:
        self._clock, self._last_sequence = SourceClock(self._latency_s), None
        listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            listening.setblocking(False)
            listening.bind(self._address)
        except OSError as error:
            listening.close()
            raise LinkLost(
                f"{self.name}: cannot listen on {self._address[0]}: close the program that holds "
                f"the port, or choose another ({error.strerror})"
            ) from error
        self.port = listening.getsockname()[1]
        self._socket = listening
        self._loop.add_reader(listening, self._receive)

    def _end(self) -> None:
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _receive(self) -> None:
        for _ in range(AT_ONCE):
            if self._socket is None:
                return
            try:
                data, address = self._socket.recvfrom(READ_SIZE)
            except OSError:  # nothing is left, or a sender's port was unreachable
                return
            self.take(data, address[0], self._loop.time())

    def take(self, data: bytes, sender: str, arrived_s: float) -> None:
        """Take one datagram that arrived from an address at a loop time."""
        counters = self.counters
        if sender != self._sender:
            counters.foreign += 1
            return
        datagram = decode_datagram(data)
        if datagram is None:
            counters.malformed += 1
            return
        sequence, (time_ms, x, y, z, valid) = datagram
        restarts = self._clock.restarts
        at_s = self._clock.loop_s(time_ms / 1000.0, arrived_s)
        restarted = self._clock.restarts > restarts
        counters.clock_restarts += restarted
        last = None if restarted else self._last_sequence
        if at_s is None or (last is not None and sequence <= last):
            counters.out_of_order += 1
            return
        counters.lost += 0 if last is None else sequence - last - 1
        self._last_sequence = sequence
        self._deliver(Position(at_s, x, y, z, valid))
