"""State of the neurons and filters of many lanes, in blocks, carried through time."""

from __future__ import annotations

from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.kernel import constants, neuron_step
from rigctl.encoder.kernel.machine_code import Kernel, lanes_per_block
from rigctl.encoder.kernel.prefetch import READING_BYTES, TrialViews, first_readings
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters

Counts = NDArray[np.uint8]


class NeuronBlocks:
    """Neurons of each lane, with equal spikes for any slicing of the samples.

    A lane is a taxel, of one trial or of several side by side, trial after trial. All start at
    rest. Silent lanes pad the last block. ``taxels``: those to encode (default all); ``sa_scale``:
    float64 (n_trials, taxels), a factor on the SA current (default 1).
    """

    def __init__(
        self,
        n_trials: int,
        normalisation: Normalisation,
        parameters: EncoderParameters,
        sa_scale: NDArray[np.float64] | None = None,
        *,
        taxels: NDArray[np.int64] | None = None,
        sa_only: bool = False,
    ) -> None:
        taxels = np.arange(normalisation.n_taxels) if taxels is None else taxels
        self.n_taxels = len(taxels)
        self._parameters, self._sa_only = parameters, sa_only
        self._taxels = np.tile(taxels, n_trials)
        self._sa_scale = np.ones(len(self._taxels)) if sa_scale is None else sa_scale.reshape(-1)
        self._constants = constants.kernel_constants(parameters)
        self._advance = constants.kernel_for(parameters, sa_only=sa_only)
        self._block_lanes = lanes_per_block(sa_only)
        self._blocks = -(-len(self._taxels) // self._block_lanes)
        self.lanes = self._blocks * self._block_lanes
        self.set_normalisation(normalisation)
        self.reset()

    def set_normalisation(self, normalisation: Normalisation) -> None:
        """Use these taxel ranges from the next sample on; neurons and filters keep their state."""
        low, high = normalisation.low[self._taxels], normalisation.high[self._taxels]
        scale = normalisation.scale[self._taxels]
        drives = constants.drives(self._parameters, scale, self._sa_scale)
        self._ranges = tuple(map(self.pad, (low, high - low, scale, *drives)))

    def reset(self) -> None:
        """Return to rest; the filter starts with the next sample."""
        self._state = constants.rest_state(self._parameters, self.lanes)
        self._filter_started = False

    def copy(self) -> Self:
        """Return neurons that go on from this state."""
        other = copy(self)
        other._state = self._state.copy()
        return other

    def empty_counts(self, rows: int) -> Counts:
        """Allocate counters of spikes in rows, uint8 (blocks, rows, channels, block lanes)."""
        channels = 1 if self._sa_only else 2
        return np.empty((self._blocks, rows, channels, self._block_lanes), np.uint8)

    def pad(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return a number for each lane; 0 for the padding: no range, no drive, no time."""
        padded = np.zeros(self.lanes, values.dtype)
        padded[: len(values)] = values
        return padded

    def advance(self, views: TrialViews, ends: NDArray[np.int64]) -> Counts:
        """Return the spikes between ends, uint8 (blocks, ends, channels, block lanes).

        ``views``: as many trials as there are side by side; counts of a lane behind its trial's end
        are undefined. ``ends``: ascending, end of each row of counts in samples, each trial's end
        among them; no row may exceed ``constants.max_samples_per_row``.
        """
        counts = self.empty_counts(len(ends))
        self._run(self._advance, views, ends, counts)
        return counts

    def encode_bits(self, views: TrialViews, words: NDArray[np.uint64]) -> int:
        """Write all spikes as bits, uint64 (planes, trains, words); return the most in one sample.

        As :func:`rigctl.encoder.kernel.transpose_bits.pack_words` says; with fewer planes than
        that, spikes are missing.
        """
        advance = constants.kernel_for(self._parameters, trains=True)
        return self._run(advance, views, np.empty(0, np.int64), words)

    def membrane_mv(self) -> NDArray[np.float64]:
        """Return the present membrane voltage, float64 (2 · lanes,), SA then RA, in mV."""
        rows = self._state[[neuron_step.M, neuron_step.M_RA], : len(self._taxels)]
        return constants.membrane_mv(self._parameters, rows.reshape(-1))

    def _run(
        self,
        advance: Kernel,
        views: TrialViews,
        ends: NDArray[np.int64],
        out: NDArray[Any],
    ) -> int:
        if not views.lengths.any():
            return 0
        first_taxels = np.repeat(views.addresses, self.n_taxels)
        addresses = self.pad(first_taxels + READING_BYTES * self._taxels)
        lengths = self.pad(np.repeat(views.lengths, self.n_taxels))
        if not self._filter_started:
            self._start_filter(addresses, lengths)
        lanes = (addresses, lengths, views.row_bytes, *self._ranges)
        return advance(*lanes, self._constants, self._state, ends, out)

    def _start_filter(self, addresses: NDArray[np.int64], lengths: NDArray[np.int64]) -> None:
        low, width, scale = self._ranges[:3]
        first = np.empty(self.lanes, np.uint16)
        first_readings(addresses, lengths, first)
        x = np.minimum(np.maximum(first, low) - low, width).astype(np.float64)
        constants.start_filter(self._parameters, x, scale, self._state)
        self._filter_started = True
