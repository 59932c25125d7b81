"""The finger board's whole sample counter, of which a data frame holds only the low 16 bits."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.wire.taxels.wire_constants import JITTER, LATE, MAX_JUMP

_LOW, _WHOLE = 1 << 16, 1 << 32


class Placing(Enum):
    """What becomes of data frames: placed, or dropped until a status tells the whole counter."""

    PLACED = "placed"
    JOINING = "joining"
    DOUBTING = "doubting"


class PlacedRows(NamedTuple):
    """Rows of a run that are new, k of them, their whole counters int64 (k,), and how many lack
    before or between them."""

    rows: NDArray[np.int64] | slice
    counters: NDArray[np.int64]
    missing: int


class SampleCounter:
    """Places data frames by what statuses say; a counter never runs back until a reboot.

    A frame at or behind the newest is late or a repeat. One that may be behind a reboot, or too
    far ahead for 16 bits, is dropped, and so are those after it, until the next status. The counter
    survives a reconnect of a board that kept running: the samples in between are missing.
    """

    def __init__(self) -> None:
        self.placing = Placing.PLACED
        self.stale = 0
        """Data frames that repeat the newest or come behind it."""
        self._last: int | None = None
        self._reference: int | None = None
        self._witness: int | None = None
        self._previous: int | None = None
        """Newest counter of the boot before."""

    def join(self) -> None:
        """Join a stream: the next status tells the whole counter."""
        self.placing = Placing.JOINING
        self._witness = None

    def begin(self) -> bool:
        """Begin at 0 with an identity sent at boot; False for one that the board has sent before.

        A board takes longer than ``JITTER`` samples to boot.
        """
        if self._reference is not None and self._reference < JITTER:
            return False
        self._restart()
        self._reference = 0
        self.placing = Placing.PLACED
        return True

    def tell(self, samples: int, connecting: bool) -> bool:
        """Take the count of samples from a status; return whether it tells a reboot.

        A status behind the samples does while ``connecting``. Later, the first is late; a second
        that runs on from it is that of a board that began again.
        """
        newest = samples - 1
        if self._reference is not None:
            newest = _nearest(self._reference, newest, _WHOLE)
        behind = self._is_behind(newest)
        if (behind and not connecting) or self._is_of_boot_before(newest):
            before, self._witness = self._witness, newest
            if before is None or newest <= before:
                return False
        if behind:
            self._restart()
            newest = samples - 1
        self._accept(newest)
        return behind

    def place(self, low: NDArray[np.int64]) -> PlacedRows:
        """Return the rows to keep of a run of data frames, from their low 16 bits int64 (n,)."""
        if self.placing is not Placing.PLACED or not len(low):
            return _NO_ROWS
        if self._last is not None:
            counters = np.arange(self._last + 1, self._last + 1 + len(low))
            if (low == counters & 0xFFFF).all():
                self._last += len(low)
                self._reference = max(self._last, self._reference or 0)
                return PlacedRows(_ALL, counters, 0)
        return self._place_each(low.tolist())

    def _place_each(self, low: list[int]) -> PlacedRows:
        rows: list[int] = []
        counters: list[int] = []
        first = self._last
        for row, sent in enumerate(low):
            counter = sent if self._reference is None else _nearest(self._reference, sent, _LOW)
            if self._is_late(counter, sent):
                self.stale += 1
            elif self._is_doubtful(counter):
                self.placing = Placing.DOUBTING
                break
            else:
                rows.append(row)
                counters.append(counter)
                self._last = counter
                self._reference = max(counter, self._reference or 0)
        if not counters:
            return _NO_ROWS
        before = counters[0] - 1 if first is None else first
        missing = counters[-1] - before - len(counters)
        return PlacedRows(np.array(rows, np.int64), np.array(counters, np.int64), missing)

    def _restart(self) -> None:
        self._previous = self._previous if self._last is None else self._last
        self._last = self._reference = self._witness = None

    def _is_late(self, counter: int, sent: int) -> bool:
        if self._last is not None:
            return counter <= self._last
        if self._previous is None or sent < LATE:
            return False
        return (sent - self._previous + LATE) % _LOW <= 2 * LATE

    def _is_doubtful(self, counter: int) -> bool:
        """A gap across the wrap of the 16 bits looks like a reboot, whose counter begins at 0."""
        if self._reference is None:
            return False
        ahead = counter - self._reference
        if self._last is None:
            return not (-JITTER <= ahead <= MAX_JUMP and counter >= 0)
        return ahead > MAX_JUMP or (ahead > 1 and counter // _LOW != self._reference // _LOW)

    def _is_behind(self, newest: int) -> bool:
        if self.placing is Placing.JOINING:
            return self._last is not None and newest < self._last
        return self._reference is not None and newest < self._reference - JITTER

    def _is_of_boot_before(self, newest: int) -> bool:
        """Return whether a board that has just begun cannot have taken so many samples."""
        return self._last is None and self._reference == 0 and newest > MAX_JUMP

    def _accept(self, newest: int) -> None:
        self._witness = None
        self._reference = max(newest, self._reference or 0)
        if self.placing is Placing.JOINING or self._last is None or newest > self._last:
            self.placing = Placing.PLACED


_ALL = slice(None)
_NO_ROWS = PlacedRows(np.zeros(0, np.int64), np.zeros(0, np.int64), 0)


def _nearest(reference: int, low_bits: int, modulus: int) -> int:
    """Return the integer nearest to ``reference`` that equals ``low_bits`` modulo ``modulus``."""
    half = modulus // 2
    return reference + (low_bits - reference + half) % modulus - half
