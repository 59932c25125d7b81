"""The encoder's range where none is calibrated: that of all readings so far."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.encoding.encoder import Encoder
from rigctl.encoding.normalisation import Normalisation, RunningRange
from rigctl.values import Block

RELEASE_S = 10.0
"""So long after the last touch by hand the sensor is at rest again."""


class FollowedRange:
    """Widens the range with each block; ``set_range`` gets each new one.

    The encoder counts readings outside its range anyway: the range can grow only then.
    """

    def __init__(
        self, n_taxels: int, encoder: Encoder, set_range: Callable[[Normalisation], None]
    ) -> None:
        reading = encoder.parameters.reading
        self._running = RunningRange(n_taxels, reading.least_range, reading)
        self._encoder = encoder
        self._set_range = set_range
        self._clipped = -1
        self._is_held = False
        self._resumes_s = 0.0
        self._seen_s = 0.0

    def add(self, block: Block) -> None:
        """Widen the range to a block's readings, unless a person touches the sensor."""
        before, self._clipped = self._clipped, int(self._encoder.clipped_counts.sum())
        self._seen_s = block.arrived_s
        if self._is_held or block.arrived_s < self._resumes_s:
            return
        if self._clipped != before and self._running.update(self._encoder.readings(block.samples)):
            self._set_range(self._running.normalisation)

    def hold(self) -> None:
        """Keep the range as it is: a person touches the sensor, harder than any texture."""
        self._is_held = True

    def release(self) -> None:
        """Go on once the last touch is over."""
        if self._is_held:
            self._is_held = False
            self._resumes_s = self._seen_s + RELEASE_S
