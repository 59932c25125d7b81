"""The finger board's own firmware, compiled for this computer, at the end of a cable in memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.board_messages import N_TAXELS
from tests.boards.memory_link import JumpingLoop, MemoryLink

TICK_S = 0.002


class FirmwareBoard:
    """Two samples every 2 ms, and an answer to each write 0.5 ms later.

    ``silent``: the cable carries nothing; ``spoil``: changes the bytes on their way to the host.
    """

    def __init__(self, loop: JumpingLoop, link: MemoryLink) -> None:
        self.firmware = FingerFirmware()
        self.silent = False
        self.spoil: Callable[[bytes], bytes] = lambda data: data
        self.samples = 0
        self._loop = loop
        self._link = link
        link.board = self.receive
        self.firmware.boot(0)
        self._send()
        loop.call_later(TICK_S, self._tick)

    def reboot(self) -> None:
        """Start anew, as after a loss of supply."""
        self.samples = 0
        self.firmware.boot(0)
        self._send()

    def receive(self, data: bytes) -> None:
        if not self.silent:
            self.firmware.receive(data)
            self._send(0.0005)

    def run(self, samples: int) -> None:
        """Take samples now; sample n of taxel i reads 100 + (n + i) % 500."""
        numbers = np.arange(self.samples, self.samples + samples)[:, None] + np.arange(N_TAXELS)
        self.firmware.run((100 + numbers % 500).astype(np.uint16))
        self.samples += samples

    def _tick(self) -> None:
        self.run(round(TICK_S * 1000))
        self._send()
        self._loop.call_later(TICK_S, self._tick)

    def _send(self, after_s: float = 0.0) -> None:
        data = self.firmware.take_sent()
        if data and not self.silent:
            self._link.say(self.spoil(data), after_s)
