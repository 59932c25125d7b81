"""A chip with its bootloader behind a pseudo-terminal, in real time: what avrdude talks to.

Opening the terminal resets the chip, as the line DTR does, and the terminal's baud rate is the
host's.
"""

from __future__ import annotations

import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from rigctl.bench.chips.simavr import Chip, Kind, load_library
from tests.firmware.building import built

HZ = 16_000_000
SLICE_S = 0.002
MAX_LAG_S = 0.02
"""On a busy computer the chip runs slower instead of catching up: its bootloader gives up later."""
_BAUD = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdecimal()
}


class FlashBoard:
    """One board; leaving the context frees it.

    ``on_bytes`` is called when bytes have come, ``times_opened`` counts how often the host has
    opened the port. A board that is ``deaf`` has a cable that carries nothing; ``carry`` is what
    the cable makes of the board's bytes.
    """

    def __init__(self, image: Path, kind: Kind, bootloader: Path) -> None:
        self.chip = Chip(load_library(built("sim/libchips.so")), image, kind, bootloader)
        self.chip.io.analog_rows = 1
        self.chip.io.loadcell_period_q16 = 198_413 << 16
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self.master, False)
        self.times_opened = 0
        self.bytes_received = 0
        self.on_bytes: Callable[[], None] = lambda: None
        self.deaf = False
        self.carry: Callable[[bytes], bytes] = bytes
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        self.chip.close()
        os.close(self.master)

    def _serve(self) -> None:
        poller, was_open = select.poll(), False
        poller.register(self.master, 0)
        waiting = b""
        before_s = time.monotonic()
        while not self._stop.wait(SLICE_S / 2):
            is_open = not any(events & select.POLLHUP for _, events in poller.poll(0))
            if is_open and not was_open:
                self.times_opened += 1
                self.chip.reset()
            was_open = is_open
            waiting += self._read() if is_open else b""
            waiting = waiting[self.chip.send(waiting, int(self.chip.io.cycle)) :]
            now_s = time.monotonic()
            passed_s, before_s = min(now_s - before_s, MAX_LAG_S), now_s
            self._advance(int(self.chip.io.cycle) + int(passed_s * HZ), is_open)

    def _advance(self, until: int, is_open: bool) -> None:
        """Run to the present time in short slices, whose bytes fit the buffers."""
        baud = _BAUD.get(termios.tcgetattr(self.master)[4], 115_200)
        self.chip.io.host_byte_q16 = round(HZ * 10 / baud * 65536)
        while (cycle := int(self.chip.io.cycle)) < until and not self._stop.is_set():
            self.chip.run(min(until, cycle + int(SLICE_S * HZ)))
            data = self.carry(self.chip.tx[: self.chip.io.tx_count].tobytes())
            if is_open and data and not self.deaf:
                try:
                    os.write(self.master, data)
                except (BlockingIOError, OSError):
                    return

    def _read(self) -> bytes:
        try:
            data = os.read(self.master, 1024)
        except OSError:
            return b""
        self.bytes_received += len(data)
        self.on_bytes()
        return b"" if self.deaf else data
