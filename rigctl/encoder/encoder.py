"""Encode samples as spikes: a streaming encoder for live use, and the same kernel for whole trials.

:func:`encode_trials` returns the spike trains of many trials. Where counts in time bins are enough,
:func:`rigctl.encoder.batch.count_spikes` is faster: it stores no spikes, and can leave out the RA
channel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.force_gain import ForceGain
from rigctl.encoder.kernel import NeuronBlocks, TrainEncoder, TrialViews, to_raster
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, KERNEL_RA_ORDER, EncoderParameters
from rigctl.encoder.reading import Reading, conductance
from rigctl.errors import WrongUse
from rigctl.values import Spikes

Samples = NDArray[np.uint16]
GainOf = Callable[[Normalisation], ForceGain]
"""The gain for taxel ranges, such as :func:`rigctl.encoder.force_gain.divided`."""

# Lanes to encode side by side, at most: few unused ones in the last block, much work for a call.
TILE_LANES = 2048


class Encoder:
    """Streaming encoder of one taxel array, with equal spikes for any slicing of the samples.

    Starts at rest. Call :meth:`reset` where a trial starts (the rise of sync) and after a long
    gap.
    The first call compiles or loads the kernel; :meth:`warm_up` does that beforehand.
    ``sa_scale``: float64 (n_taxels,), a factor on the SA current of each taxel, or None for 1.
    ``inputs``: the input of each taxel (:func:`rigctl.encoder.reading.input_of_each`), which the
    reading ``conductance`` needs; the ranges are in its unit, samples remain counts. ``gain_of``:
    the gain on the readings that the SA channel takes, for the current ranges; None for 1.
    Raises :class:`WrongUse` for parameters whose RA filter needs whole trials.
    """

    def __init__(
        self,
        normalisation: Normalisation,
        parameters: EncoderParameters = DEFAULT,
        sa_scale: NDArray[np.float64] | None = None,
        inputs: Sequence[int] = (),
        gain_of: GainOf | None = None,
    ) -> None:
        normalisation.check_reading(parameters)
        if parameters.filters_whole_trials:
            raise WrongUse(
                f"encoder preset {parameters.name!r} filters whole trials in its RA channel, "
                "which a stream of samples does not allow: choose one with ra_filter causal and "
                f"ra_order {KERNEL_RA_ORDER}"
            )
        self.parameters = parameters
        self._inputs = inputs
        self._gain_of = gain_of
        self._sa_scale = None if sa_scale is None else sa_scale[None, :]
        self._normalisation = normalisation
        self._gain = gain_of(normalisation) if gain_of else None
        self._blocks = self._blocks_at_rest()
        self._clipped_counts = np.zeros(normalisation.n_taxels, np.int64)

    @property
    def normalisation(self) -> Normalisation:
        """The current taxel ranges."""
        return self._normalisation

    @normalisation.setter
    def normalisation(self, value: Normalisation) -> None:
        """Use other ranges from the next sample on; neurons and filters keep their state."""
        if value.n_taxels != self._normalisation.n_taxels:
            raise WrongUse(
                f"the encoder has {self._normalisation.n_taxels} taxels, but the new ranges have "
                f"{value.n_taxels}"
            )
        value.check_reading(self.parameters)
        self._normalisation = value
        self._gain = self._gain_of(value) if self._gain_of else None
        self._blocks.set_normalisation(self._lane_ranges)

    @property
    def clipped_counts(self) -> NDArray[np.int64]:
        """Readings outside the range so far, for each taxel, int64 (n_taxels,)."""
        return self._clipped_counts.copy()

    def reset(self) -> None:
        """Put the neurons at rest; the filter starts at the next sample."""
        self._blocks.reset()

    def copy(self) -> Self:
        """Return an encoder that goes on from here, while this one stays as it is."""
        other = copy(self)
        other._blocks = self._blocks.copy()
        other._clipped_counts = self.clipped_counts
        return other

    def warm_up(self) -> None:
        """Compile or load the kernel before time matters; state and counts do not change."""
        self._encode(self._blocks_at_rest(), np.zeros((1, self._normalisation.n_taxels), np.uint16))

    def encode(self, samples: Samples) -> NDArray[np.uint8]:
        """Return the spikes of each sample: uint16 (n, n_taxels) → uint8 (n, 2·n_taxels), SA, RA.

        Samples are counts. Raises :class:`WrongUse` for another number of taxels.
        """
        _check(samples, self._normalisation)
        samples = self.readings(samples)
        self._clipped_counts += self._normalisation.count_clipped(samples)
        return self._encode(self._blocks, samples)

    def membrane_mv(self, samples: Samples) -> NDArray[np.float64]:
        """Go on as :meth:`encode`; return the voltages as :func:`membrane_mv` does."""
        _check(samples, self._normalisation)
        taken = self._taken(self.readings(samples))
        return self._of_channels(_membrane_mv(self._blocks, taken, self.parameters))

    def readings(self, samples: Samples) -> Samples:
        """Return counts uint16 (n, n_taxels) in the reading that ranges and neurons take."""
        if self.parameters.reading is Reading.COUNTS:
            return samples
        return conductance(samples, self._inputs)

    # With a gain there are neurons for the scaled readings and, behind them, for the plain ones: a
    # second call of the kernel would take longer than the neurons that nobody asks for.

    @property
    def _lane_ranges(self) -> Normalisation:
        ranges, times = self._normalisation, 1 if self._gain is None else 2
        return replace(ranges, low=np.tile(ranges.low, times), high=np.tile(ranges.high, times))

    def _blocks_at_rest(self) -> NeuronBlocks:
        scale = self._sa_scale
        if scale is not None and self._gain is not None:
            scale = np.tile(scale, 2)
        return NeuronBlocks(1, self._lane_ranges, self.parameters, scale)

    def _taken(self, readings: Samples) -> Samples:
        """Return what the neurons take of readings."""
        if self._gain is None:
            return readings
        return np.concatenate([self._gain.apply(readings), readings], axis=1)

    def _of_channels(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return SA of the scaled and RA of the plain readings, from values of all neurons."""
        if self._gain is None:
            return values
        n = self._normalisation.n_taxels
        return np.concatenate([values[:, :n], values[:, 3 * n :]], axis=1)

    def _encode(self, blocks: NeuronBlocks, readings: Samples) -> NDArray[np.uint8]:
        taken = self._taken(readings)
        counts = blocks.advance(TrialViews.from_arrays([taken]), np.arange(1, len(taken) + 1))
        return self._of_channels(to_raster(counts, blocks.n_taxels))


def _check(samples: Samples, normalisation: Normalisation) -> None:
    if samples.ndim != 2 or samples.shape[1] != normalisation.n_taxels:
        raise WrongUse(
            f"samples of shape {samples.shape} do not fit ranges of {normalisation.n_taxels} taxels"
        )


def encode_trial(
    samples: Samples, normalisation: Normalisation, parameters: EncoderParameters = DEFAULT
) -> Spikes:
    """Return the spike trains of one trial, encoded from rest. Samples uint16 (n, n_taxels)."""
    return encode_trials([samples], normalisation, parameters)[0]


def encode_trials(
    trials: Sequence[Samples],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
    gains: Sequence[ForceGain] = (),
) -> list[Spikes]:
    """Return the spike trains of many trials, encoded side by side, each from rest.

    Trials of the same tile share memory: to keep one and free the others, copy it.
    ``trials``: uint16 (n_i, n_taxels) each, in the reading of ranges and parameters.
    ``sa_scale``: float64 (n_trials, n_taxels), a factor on the SA current of each trial and taxel
    (the force matrix C), or None for 1 everywhere. ``gains``: of each trial, on the readings that
    the SA channel takes; none for 1.
    """
    if gains:
        scaled = [gain.apply(samples) for gain, samples in zip(gains, trials, strict=True)]
        sa = encode_trials(scaled, normalisation, parameters, sa_scale=sa_scale)
        ra = encode_trials(trials, normalisation, parameters)
        pairs = zip(sa, ra, strict=True)
        return [_with_channels(of_sa, of_ra, normalisation.n_taxels) for of_sa, of_ra in pairs]
    normalisation.check_reading(parameters)
    for samples in trials:
        _check(samples, normalisation)
    spikes: dict[int, Spikes] = {}
    encoder = TrainEncoder(parameters)
    for selected in tiles([len(samples) for samples in trials], normalisation.n_taxels):
        scale = None if sa_scale is None else sa_scale[selected]
        blocks = NeuronBlocks(len(selected), normalisation, parameters, scale)
        views = TrialViews.from_arrays([trials[i] for i in selected])
        spikes.update(zip(selected, encoder.encode(blocks, views), strict=True))
    if parameters.filters_whole_trials:
        # Imported here: SciPy's filters take a second to load, and only these presets need them.
        from rigctl.encoder.ra_neurons import with_ra_trains

        return [
            with_ra_trains(spikes[i], samples, normalisation, parameters)
            for i, samples in enumerate(trials)
        ]
    return [spikes[i] for i in range(len(trials))]


def _with_channels(sa: Spikes, ra: Spikes, n_taxels: int) -> Spikes:
    """Return the SA trains of one with the RA trains of another encoding of the same trial."""
    trains = [sa.train(row) for row in range(n_taxels)]
    trains += [ra.train(row) for row in range(n_taxels, 2 * n_taxels)]
    return Spikes.from_trains(trains, ra.n_samples)


def tiles(lengths: Sequence[int], n_taxels: int) -> Iterator[list[int]]:
    """Yield the indices of trials to encode side by side: similar in length, the longest last."""
    order = np.argsort(np.array(lengths, np.int64), kind="stable").tolist()
    tile_trials = max(1, TILE_LANES // n_taxels)
    for start in range(0, len(order), tile_trials):
        yield order[start : start + tile_trials]


def membrane_mv(
    samples: Samples,
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return the membrane voltage after each sample, float64 (n, 2·n_taxels) in mV, SA then RA.

    Encoded from rest. A sample with a spike shows the threshold, as such curves are usually drawn.
    ``sa_scale``: float64 (1, n_taxels), a factor on the SA current of each taxel, or None for 1.
    """
    _check(samples, normalisation)
    blocks = NeuronBlocks(1, normalisation, parameters, sa_scale)
    voltage = _membrane_mv(blocks, samples, parameters)
    if parameters.filters_whole_trials:
        from rigctl.encoder.ra_neurons import ra_response

        ra = ra_response(samples, normalisation, parameters)
        shown = np.where(ra.spikes > 0, parameters.threshold_mv, ra.membrane_mv)
        voltage[:, normalisation.n_taxels :] = shown
    return voltage


def _membrane_mv(
    blocks: NeuronBlocks, samples: Samples, parameters: EncoderParameters
) -> NDArray[np.float64]:
    """Return the voltage of neurons after each sample, float64 (n, 2·n_taxels), SA then RA."""
    voltage = np.empty((len(samples), 2 * blocks.n_taxels))
    for t in range(len(samples)):
        counts = blocks.advance(TrialViews.from_arrays([samples[t : t + 1]]), np.array([1]))
        fired = to_raster(counts, blocks.n_taxels)[0] > 0
        voltage[t] = np.where(fired, parameters.threshold_mv, blocks.membrane_mv())
    return voltage
