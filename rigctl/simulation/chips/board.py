"""One simulated chip as a board on the bench, with its clock and its cable to the host."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.simulation.chips.simavr import Chip
from rigctl.simulation.simulated_rig import SimulatedLink

NOMINAL_HZ = 16_000_000
BITS_PER_BYTE = 10


class BoardClock:
    """Exact conversion between simulated µs and chip cycles.

    The resonator is fast by ``ppm``; the chip is switched on at ``on_us``.
    """

    def __init__(self, ppm: float, on_us: int = 0) -> None:
        self._on_us = on_us
        self._rate_mhz = NOMINAL_HZ * 1000 + round(ppm * NOMINAL_HZ / 1000)

    def cycle(self, at_us: float) -> int:
        """Return the cycle at a simulated time; 0 before the chip is switched on."""
        return int(max(0, at_us - self._on_us) * self._rate_mhz // 10**9)

    def us(self, cycle: int) -> float:
        """Return the simulated time of a cycle."""
        return self._on_us + cycle * 1e9 / self._rate_mhz

    @property
    def cycles_per_us(self) -> float:
        """Cycles in one simulated microsecond."""
        return self._rate_mhz / 1e9


class ChipBoard:
    """A chip with clock and cable. ``now_us`` returns the time at which the host writes.

    ``baud`` is the host's; each byte takes its real time in both directions.
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
        self._waiting = self._replying = False
        self._to_host = bytearray()
        self._on_wire = b""
        self._arrived_us = 0.0
        byte_us = BITS_PER_BYTE * 1e6 / baud
        chip.io.host_byte_q16 = round(byte_us * clock.cycles_per_us * 65536)
        link.attach(self._receive)

    def is_reply_pending(self, timeout_us: int) -> bool:
        """Return whether a reply to the host's last write may still arrive.

        The reply has ended when the board has sent something and was then silent for one run.
        """
        return self._waiting and self._now_us() - self._written_us < timeout_us

    def run(self, until_us: int) -> None:
        """Run the chip up to a simulated time."""
        if self._to_board:
            taken = self.chip.send(self._to_board, self.clock.cycle(self._written_us))
            self._to_board = self._to_board[taken:]
        end = self.clock.cycle(until_us)
        self.chip.run(end)
        self._collect(end)

    def deliver(self) -> None:
        """Deliver the bytes that have arrived at the host since the last call."""
        if self._to_host:
            data, self._to_host = bytes(self._to_host), bytearray()
            self.link.deliver(data, self._arrived_us / 1e6)

    def _receive(self, data: bytes) -> None:
        self._to_board += data
        self._written_us = self._now_us()
        self._waiting, self._replying = True, False

    def _collect(self, end: int) -> None:
        """Collect the bytes whose stop bit has ended; a last one may still be on the wire."""
        count = self.chip.io.tx_count
        self._to_host += self._on_wire
        self._on_wire = b""
        self._waiting = self._waiting and not (self._replying and count == 0)
        self._replying = count > 0
        if count == 0:
            return
        cycles = self.chip.tx_cycle[:count]
        arrived = count
        while arrived and cycles[arrived - 1] > end:
            arrived -= 1
        self._to_host += self.chip.tx[:arrived].tobytes()
        self._on_wire = self.chip.tx[arrived:count].tobytes()
        # If all are still on the wire, the bytes before them arrived a moment earlier.
        self._arrived_us = self.clock.us(int(cycles[arrived - 1]) if arrived else end)
