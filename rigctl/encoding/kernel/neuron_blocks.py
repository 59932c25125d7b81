"""Neurons and filters of many lanes, in blocks as the kernel takes them, carried through time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.kernel import constants
from rigctl.encoding.kernel.machine_code import LANES, LANES_OF_SA, Kernel
from rigctl.encoding.kernel.prefetch import BYTES, TrialRows, first_readings
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters

Samples = NDArray[np.uint16]
Counts = NDArray[np.uint8]


def filled_up(lanes: int, wide: int) -> int:
    """Lanes of the blocks, so wide each, that hold so many."""
    return -(-lanes // wide) * wide


class NeuronBlocks:
    """Neurons of each lane, equal for any slicing of the samples; lanes that fill up are silent.

    A lane is a taxel, of one trial or of several side by side, trial after trial. All start at
    rest. ``wide``: lanes of a block.
    """

    def __init__(
        self,
        normalisation: Normalisation,
        taxels: NDArray[np.int64],
        parameters: EncoderParameters,
        sa_scale: NDArray[np.float64],
        sa_only: bool,
    ) -> None:
        self._parameters, self._taxels, self._sa_scale = parameters, taxels, sa_scale
        self._sa_only = sa_only
        self._constants = constants.folded(parameters)
        self._advance = constants.kernel_for(parameters, sa_only=sa_only)
        self.wide = LANES_OF_SA if sa_only else LANES
        self._n = filled_up(len(taxels), self.wide)
        self.use_ranges(normalisation)
        self.reset()

    @property
    def lanes(self) -> int:
        """Lanes of all blocks."""
        return self._n

    @classmethod
    def of_taxels(cls, normalisation: Normalisation, parameters: EncoderParameters) -> NeuronBlocks:
        """A lane for each taxel."""
        return cls.of_trials(1, normalisation, parameters)

    @classmethod
    def of_trials(
        cls,
        n_trials: int,
        normalisation: Normalisation,
        parameters: EncoderParameters,
        sa_scale: NDArray[np.float64] | None = None,
        *,
        taxels: NDArray[np.int64] | None = None,
        sa_only: bool = False,
    ) -> NeuronBlocks:
        """A lane for each trial and taxel (some ``taxels`` only, or all).

        ``sa_scale``: float64 (n_trials, taxels), a factor on the SA current, or None for 1.
        """
        if taxels is None:
            taxels = np.arange(normalisation.n_taxels)
        if sa_scale is None:
            sa_scale = np.ones((n_trials, len(taxels)))
        lanes = np.broadcast_to(taxels, (n_trials, len(taxels))).reshape(-1)
        return cls(normalisation, lanes, parameters, sa_scale.reshape(-1), sa_only)

    def use_ranges(self, normalisation: Normalisation) -> None:
        """Use these taxel ranges from the next sample on; neurons and filters go on."""
        low, high = normalisation.low[self._taxels], normalisation.high[self._taxels]
        scale = normalisation.scale[self._taxels]
        drives = constants.drives(self._parameters, scale, self._sa_scale)
        reals = (self.by_lane(values) for values in (scale, *drives))
        self._lanes = (self.by_lane(low), self.by_lane(high - low), *reals)

    def reset(self) -> None:
        """Back to rest; the filter starts with the next sample."""
        self._state = constants.rest(self._parameters, self._n)
        self._fresh = True

    def room_for(self, rows: int) -> Counts:
        """Memory for the spikes in so many rows, uint8 (blocks, rows, channels, wide)."""
        channels = 1 if self._sa_only else 2
        return np.empty((self._n // self.wide, rows, channels, self.wide), np.uint8)

    def by_lane(self, values: NDArray[Any]) -> NDArray[Any]:
        """A number for each lane; 0 behind the last one: no range, no drive, no time."""
        full = np.zeros(self._n, values.dtype)
        full[: len(values)] = values
        return full

    def advance(self, rows: TrialRows, ends: NDArray[np.int64]) -> Counts:
        """Spikes between ends, uint8 (blocks, ends, channels, wide).

        ``rows``: readings of as many trials as there are side by side; what a lane shows behind
        its trial's end means nothing. ``ends``: ascending, first sample behind each row of
        counts, each trial's end among them; no row may be longer than
        ``kernel.samples_per_row``.
        """
        counts = self.room_for(len(ends))
        self._run(self._advance, rows, ends, counts, np.empty(0))
        return counts

    def take_trains(self, rows: TrialRows, words: NDArray[np.uint64]) -> int:
        """Keep all spikes as bits, uint64 (planes, trains, words); the most in one sample.

        As :func:`rigctl.encoding.kernel.transpose_bits.keep` says; with fewer planes spikes are
        missing.
        """
        advance = constants.kernel_for(self._parameters, trains=True)
        return self._run(advance, rows, np.empty(0, np.int64), words, np.empty(0))

    def traced_mv(self, rows: TrialRows) -> tuple[Counts, NDArray[np.float64]]:
        """Spikes and membrane voltage in mV of each sample, both (blocks, n, channels, wide)."""
        advance = constants.kernel_for(self._parameters, sa_only=self._sa_only, traced=True)
        ends = np.arange(1, rows.lengths.max() + 1)
        counts = self.room_for(len(ends))
        trace = np.empty(counts.shape)
        self._run(advance, rows, ends, counts, trace)
        return counts, constants.membrane_mv(self._parameters, trace)

    def _run(
        self,
        advance: Kernel,
        rows: TrialRows,
        ends: NDArray[np.int64],
        out: NDArray[Any],
        trace: NDArray[np.float64],
    ) -> int:
        if not rows.lengths.any():
            return 0
        some = len(self._taxels) // len(rows)
        addresses = self.by_lane(np.repeat(rows.addresses, some) + BYTES * self._taxels)
        lengths = self.by_lane(np.repeat(rows.lengths, some))
        if self._fresh:
            self._start_filter(addresses, lengths)
        lanes = (addresses, lengths, rows.row_bytes, *self._lanes)
        return advance(*lanes, self._constants, self._state, ends, out, trace)

    def _start_filter(self, addresses: NDArray[np.int64], lengths: NDArray[np.int64]) -> None:
        low, width, scale = self._lanes[:3]
        first = np.empty(self._n, np.uint16)
        first_readings(addresses, lengths, first)
        x = np.minimum(np.maximum(first, low) - low, width).astype(np.float64)
        constants.start_filter(self._parameters, x, scale, self._state)
        self._fresh = False
