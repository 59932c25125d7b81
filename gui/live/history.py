"""What a live buffer of samples offers, of the drum's sensor or of the finger's."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

SPAN_S = 10


class SampleWindow(Protocol):
    """Newest samples of a live buffer; ``first`` is the number of the oldest."""

    @property
    def first(self) -> int:
        """Samples written before these."""

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Loop times, (n,)."""

    @property
    def counters(self) -> NDArray[np.int64]:
        """The board's counters, (n,)."""

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Readings, (n, taxels)."""

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Bits of the wire, (n,)."""

    @property
    def spikes(self) -> NDArray[np.uint8]:
        """Spikes, (n, neurons)."""

    def __len__(self) -> int: ...


_Window_co = TypeVar("_Window_co", bound=SampleWindow, covariant=True)


class LiveSamples(Protocol[_Window_co]):
    """A live buffer of samples, of the drum's sensor or of the finger's."""

    @property
    def taxel_head(self) -> int:
        """Samples written since the engine started."""

    def taxels(self, n: int) -> _Window_co:
        """Return the newest ``n`` samples."""
