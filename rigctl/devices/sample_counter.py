"""The finger board's whole sample counter, of which a data frame holds only the low 16 bits."""

from __future__ import annotations

from rigctl.wire.finger.decoder import FingerBlock

_WRAP = 1 << 16


class SampleCounter:
    """Places blocks by the whole counter that a status holds; counts what is missing.

    It survives a reconnect of a board that kept running: the samples in between are missing.
    """

    def __init__(self) -> None:
        self.last: int | None = None
        """Whole counter of the newest sample, None before the first."""
        self._decoded = -1
        self._base: int | None = None

    @property
    def placed(self) -> bool:
        """True once a status has told the whole counter."""
        return self._base is not None

    def join(self) -> None:
        """Join a stream with a new decoder: the next status tells the whole counter."""
        self._decoded = -1
        self._base = None

    def restart(self) -> None:
        """Forget the newest sample: the board's counter began again."""
        self.last = None
        self.join()

    def is_behind(self, samples: int) -> bool:
        """Return whether a status with ``samples`` comes from a board that has rebooted."""
        return self.last is not None and samples <= self.last

    def tell(self, samples: int) -> None:
        """Take the count of samples from a status, which follows its newest sample."""
        if self._base is None and self._decoded >= 0:
            self._base = round((samples - 1 - self._decoded) / _WRAP) * _WRAP

    def place(self, block: FingerBlock) -> FingerBlock | None:
        """Return the block with whole counters and its missing samples.

        None where it is empty, or where no status has come yet.
        """
        if not len(block.counters):
            return None
        self._decoded = int(block.counters[-1])
        if self._base is None:
            return None
        counters = block.counters + self._base
        before = int(counters[0]) - 1 if self.last is None else self.last
        self.last = int(counters[-1])
        return block._replace(counters=counters, missing=self.last - before - len(counters))
