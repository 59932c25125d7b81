"""The drum's virtual board as the host meets it: its cable, with bytes that take their time."""

from __future__ import annotations

import math
from collections import deque

from rigctl.simulation.boards.drum_stepper import DrumStepper
from rigctl.simulation.simulated_rig import SimulatedLink

BYTE_CYCLES = 16_000_000 * 10 // 115_200
"""Bytes that lie farther apart belong to two replies."""


class VirtualDrum:
    """Carries bytes between a link and the board. Times are world microseconds."""

    def __init__(self, drum: DrumStepper, link: SimulatedLink) -> None:
        self._drum = drum
        self._link = link
        self._replies: deque[tuple[bytes, float]] = deque()
        self._complete_us = -math.inf
        self.now_us = 0
        link.attach(self._receive)

    @property
    def next_us(self) -> float:
        """When a request is complete or a reply has arrived; infinite while nothing is sent."""
        if self._replies:
            return self._replies[0][1]
        return self._complete_us if self._complete_us >= self.now_us else math.inf

    def pass_time(self, now_us: int) -> None:
        """Hand over the replies that have arrived by now, each whole."""
        self.now_us = now_us
        if self._drum.board.exchange.tx_count:
            self._take_replies()
        while self._replies and self._replies[0][1] <= now_us:
            data, at_us = self._replies.popleft()
            self._link.deliver(data, at_us * 1e-6)

    def reset(self) -> None:
        """The board was reset: what it had not sent stays unsaid."""
        self._drum.board.take_sent()
        self._replies.clear()
        self._complete_us = -math.inf

    def _receive(self, data: bytes) -> None:
        self._drum.board.receive(data, self._drum.cycle(self.now_us))
        # Whole milliseconds: the board runs in them, and has answered at the end of the next.
        complete_us = self._drum.us(self._drum.board.exchange.received_at)
        self._complete_us = 1000.0 * math.ceil(complete_us * 1e-3)

    def _take_replies(self) -> None:
        data, cycles = self._drum.board.take_sent()
        first = 0
        for behind in range(1, len(data) + 1):
            if behind < len(data) and cycles[behind] - cycles[behind - 1] <= 1.5 * BYTE_CYCLES:
                continue
            arrives_us = self._drum.us(cycles[behind - 1])
            self._replies.append((data[first:behind], arrives_us))
            first = behind
