"""One simulated chip as a board on the bench: its own clock, and its cable to the host."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.simulation.chips.simavr import Chip
from rigctl.simulation.simulated_rig import SimulatedLink

NOMINAL_HZ = 16_000_000
BITS_PER_BYTE = 10


class BoardClock:
    """World microseconds ↔ chip cycles, exact: a resonator fast by ``ppm``, on since ``on_us``."""

    def __init__(self, ppm: float, on_us: int = 0) -> None:
        self._on_us = on_us
        self._rate_mhz = NOMINAL_HZ * 1000 + round(ppm * NOMINAL_HZ / 1000)

    def cycle(self, at_us: float) -> int:
        """Cycles the chip has done by a world time; 0 before it was switched on."""
        return int(max(0, at_us - self._on_us) * self._rate_mhz // 10**9)

    def us(self, cycle: int) -> float:
        """World time of a cycle."""
        return self._on_us + cycle * 1e9 / self._rate_mhz

    @property
    def cycles_per_us(self) -> float:
        """Cycles in one world microsecond."""
        return self._rate_mhz / 1e9


class ChipBoard:
    """A chip with clock and cable. ``now_us`` tells the world time at which the host writes.

    ``baud`` is the host's; bytes are on the wire for real byte times in both directions.
    """

    def __init__(
        self,
        chip: Chip,
        clock: BoardClock,
        link: SimulatedLink,
        baud: int,
        now_us: Callable[[], int],
    ) -> None:
        self.chip = chip
        self.clock = clock
        self.link = link
        self._now_us = now_us
        self._to_board = b""
        self._written_us = 0
        self._awaited = self._answering = False
        self._to_host = bytearray()
        self._on_wire = b""
        self._arrived_us = 0.0
        byte_us = BITS_PER_BYTE * 1e6 / baud
        chip.exchange.host_byte_q16 = round(byte_us * clock.cycles_per_us * 65536)
        link.attach(self._receive)

    def is_awaited(self, longest_us: int) -> bool:
        """Whether an answer to what the host wrote may still be on its way.

        It is over when the board has sent something and was silent for one run.
        """
        return self._awaited and self._now_us() - self._written_us < longest_us

    def run(self, until_us: int) -> None:
        """Let the chip catch up with the world."""
        if self._to_board:
            taken = self.chip.send(self._to_board, self.clock.cycle(self._written_us))
            self._to_board = self._to_board[taken:]
        end = self.clock.cycle(until_us)
        self.chip.run(end)
        self._collect(end)

    def deliver(self) -> None:
        """Hand over what has arrived at the host since the last time."""
        if self._to_host:
            data, self._to_host = bytes(self._to_host), bytearray()
            self.link.deliver(data, self._arrived_us / 1e6)

    def _receive(self, data: bytes) -> None:
        self._to_board += data
        self._written_us = self._now_us()
        self._awaited, self._answering = True, False

    def _collect(self, end: int) -> None:
        """Bytes whose stop bit is over have arrived; a last one may still be on the wire."""
        count = self.chip.exchange.tx_count
        self._to_host += self._on_wire
        self._on_wire = b""
        self._awaited = self._awaited and not (self._answering and count == 0)
        self._answering = count > 0
        if count == 0:
            return
        stamps = self.chip.tx_cycle[:count]
        arrived = count
        while arrived and stamps[arrived - 1] > end:
            arrived -= 1
        self._to_host += self.chip.tx[:arrived].tobytes()
        self._on_wire = self.chip.tx[arrived:count].tobytes()
        # Where all are still on the wire, what was there before them arrived a moment earlier.
        self._arrived_us = self.clock.us(int(stamps[arrived - 1]) if arrived else end)
