"""Samples to spikes: a streaming encoder for live use, and the same kernel over whole trials.

Spike trains of many trials come from :func:`encode_trials`. Where counts in stretches of time are
enough, :func:`rigctl.encoding.batch.stretch_counts` is the fast way: it keeps no spikes, and leaves
the RA channel out where only SA is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.kernel import constants, raster
from rigctl.encoding.kernel.machine_code import LANES
from rigctl.encoding.kernel.neuron_blocks import Counts, NeuronBlocks, Samples
from rigctl.encoding.kernel.prefetch import TrialRows
from rigctl.encoding.kernel.spike_trains import SpikeTrains
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse
from rigctl.values import Spikes

# Lanes that are encoded side by side, at least.
TILE_LANES = 2048


class Encoder:
    """Streaming encoder of one taxel array: equal spikes for any slicing of the samples.

    Starts at rest. :meth:`reset` where a trial starts (the rise of sync) and after a gap.
    The first call compiles or loads the kernel; :meth:`warm` does that beforehand.
    """

    def __init__(
        self, normalisation: Normalisation, parameters: EncoderParameters = DEFAULT
    ) -> None:
        self.parameters = parameters
        self._normalisation = normalisation
        self._blocks = self._at_rest()
        self._clipped = np.zeros(normalisation.n_taxels, np.int64)

    @property
    def normalisation(self) -> Normalisation:
        """The taxel ranges in use."""
        return self._normalisation

    @normalisation.setter
    def normalisation(self, value: Normalisation) -> None:
        """Use other ranges from the next sample on; neurons and filters go on as they are."""
        if value.n_taxels != self._normalisation.n_taxels:
            raise WrongUse(f"the encoder has {self._normalisation.n_taxels} taxels")
        self._normalisation = value
        self._blocks.use_ranges(value)

    @property
    def clipped(self) -> NDArray[np.int64]:
        """Readings outside the range so far, for each taxel, int64 (n_taxels,)."""
        return self._clipped.copy()

    def reset(self) -> None:
        """Neurons to rest; the filter starts at the next sample."""
        self._blocks.reset()

    def warm(self) -> None:
        """Have the kernel compiled before time matters; state and counts stay untouched."""
        self._counts(self._at_rest(), np.zeros((1, self._normalisation.n_taxels), np.uint16))

    def encode(self, samples: Samples) -> Counts:
        """Spikes of each sample: uint16 (n, n_taxels) → uint8 (n, 2·n_taxels), SA then RA.

        Raises :class:`WrongUse` for another number of taxels.
        """
        _check(samples, self._normalisation)
        self._clipped += self._normalisation.clipped(samples)
        return self._counts(self._blocks, samples)

    def _at_rest(self) -> NeuronBlocks:
        return NeuronBlocks.of_taxels(self._normalisation, self.parameters)

    def _counts(self, blocks: NeuronBlocks, samples: Samples) -> Counts:
        each = np.arange(1, len(samples) + 1)
        counts = blocks.advance(TrialRows.of([samples]), each)
        return raster.by_sample(counts, self._normalisation.n_taxels)


def _check(samples: Samples, normalisation: Normalisation) -> None:
    if samples.ndim != 2 or samples.shape[1] != normalisation.n_taxels:
        raise WrongUse(
            f"samples of shape {samples.shape} do not fit ranges of {normalisation.n_taxels} taxels"
        )


def encode_trial(
    samples: Samples, normalisation: Normalisation, parameters: EncoderParameters = DEFAULT
) -> Spikes:
    """Spike trains of one trial, started at rest. Samples uint16 (n, n_taxels)."""
    return encode_trials([samples], normalisation, parameters)[0]


def encode_trials(
    trials: Sequence[Samples],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
) -> list[Spikes]:
    """Spike trains of many trials, several at a time side by side; each starts at rest.

    Those that were side by side share memory: to keep one and let the others go, copy it.
    ``trials``: uint16 (n_i, n_taxels) each. ``sa_scale``: float64 (n_trials, n_taxels), a factor
    on the SA current of each trial and taxel (the force matrix C), or None for 1 everywhere.
    """
    for samples in trials:
        _check(samples, normalisation)
    spikes: dict[int, Spikes] = {}
    trains = SpikeTrains(constants.most_in_a_sample(parameters))
    for chosen in tiles([len(samples) for samples in trials], normalisation.n_taxels):
        scale = None if sa_scale is None else sa_scale[chosen]
        blocks = NeuronBlocks.of_trials(len(chosen), normalisation, parameters, scale)
        rows = TrialRows.of([trials[i] for i in chosen])
        spikes.update(zip(chosen, trains.of(blocks, rows, normalisation.n_taxels), strict=True))
    return [spikes[i] for i in range(len(trials))]


def tiles(lengths: Sequence[int], n_taxels: int, wide: int = LANES) -> Iterator[list[int]]:
    """Trials to encode side by side, by index: neighbours in length, the longest last.

    ``wide``: lanes of a block.
    """
    order = np.argsort(np.array(lengths, np.int64), kind="stable").tolist()
    per_tile = _per_tile(n_taxels, wide, TILE_LANES)
    for start in range(0, len(order), per_tile):
        yield order[start : start + per_tile]


@cache
def _per_tile(n_taxels: int, wide: int, lanes: int) -> int:
    """Trials that have about so many lanes.

    The last block of a tile is filled up with lanes that nobody asked for: take as many trials as
    waste fewest of them. Up to the block's width there is a number that wastes none.
    """
    least = -(-lanes // n_taxels)
    numbers = range(least, min(2 * least, least + wide))
    return min(numbers, key=lambda n: (-n * n_taxels) % wide / n)


def membrane_mv(
    samples: Samples, normalisation: Normalisation, parameters: EncoderParameters = DEFAULT
) -> NDArray[np.float64]:
    """Membrane voltage after each sample, float64 (n, 2·n_taxels) in mV, SA then RA.

    Started at rest. A sample with a spike shows the threshold, as such curves are drawn.
    """
    _check(samples, normalisation)
    blocks = NeuronBlocks.of_taxels(normalisation, parameters)
    counts, voltage = blocks.traced_mv(TrialRows.of([samples]))
    voltage = np.where(counts > 0, parameters.threshold_mv, voltage)
    return raster.by_sample(voltage, normalisation.n_taxels)
