"""Samples to spikes: a streaming encoder for live use, and the same kernel over whole trials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding import kernel, raster
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.presets import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse
from rigctl.values import Spikes

Samples = NDArray[np.uint16]
Counts = NDArray[np.uint8]

# Lanes that advance together: enough to fill the vector units, few enough to stay in the cache.
TILE_LANES = 108


@dataclass(frozen=True, slots=True)
class _Lanes:
    """What the kernel needs to know of each lane, contiguous arrays of one length."""

    low: NDArray[np.uint16]
    high: NDArray[np.uint16]
    scale: NDArray[np.float64]
    sa_drive: NDArray[np.float64]
    ra_drive: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        normalisation: Normalisation,
        parameters: EncoderParameters,
        sa_scale: NDArray[np.float64],
    ) -> _Lanes:
        """One lane for each element of ``sa_scale``, float64 (n_trials, n_taxels)."""
        sa, ra = kernel.drives(parameters)
        repeats = sa_scale.shape[0]
        return cls(
            np.tile(normalisation.low, repeats),
            np.tile(normalisation.high, repeats),
            np.tile(normalisation.scale, repeats),
            np.ascontiguousarray(sa * sa_scale.reshape(-1), dtype=np.float64),
            np.full(sa_scale.size, ra),
        )


class _Stream:
    """Neurons and filters of some lanes, carried from one stretch of samples to the next."""

    def __init__(self, lanes: _Lanes, parameters: EncoderParameters) -> None:
        self.lanes = lanes
        self._parameters = parameters
        self._constants = kernel.folded(parameters)
        self._advance = kernel.kernel_for(parameters)
        self._rest = kernel.rest(parameters, lanes.low.shape[0])
        self._state = self._rest.copy()
        self._fresh = True

    def reset(self) -> None:
        """Back to rest; the filter starts with the next sample."""
        self._state[:] = self._rest
        self._fresh = True

    def counts(self, samples: Samples, out: Counts | None = None) -> Counts:
        """Spikes of each sample, uint8 (n, 2·lanes), in ``out`` where it is given."""
        if out is None:
            out = np.empty((samples.shape[0], 2 * samples.shape[1]), np.uint8)
        self._run(self._advance, samples, out, np.empty((0, out.shape[1])))
        return out

    def membrane_mv(self, samples: Samples) -> NDArray[np.float64]:
        """Membrane voltage after each sample in mV, float64 (n, 2·lanes)."""
        out = np.empty((samples.shape[0], 2 * samples.shape[1]), np.uint8)
        trace = np.empty(out.shape)
        self._run(kernel.kernel_for(self._parameters, traced=True), samples, out, trace)
        return kernel.membrane_mv(self._parameters, trace)

    def _run(
        self, advance: kernel.Kernel, samples: Samples, out: Counts, trace: NDArray[np.float64]
    ) -> None:
        if samples.shape[0] == 0:
            return
        lanes = self.lanes
        # A sliced view makes the kernel several times slower.
        samples = np.ascontiguousarray(samples, dtype=np.uint16)
        ranges = (lanes.low, lanes.high, lanes.scale)
        if self._fresh:
            kernel.start_filter(samples[0], *ranges, self._constants, self._state)
            self._fresh = False
        drives = (lanes.sa_drive, lanes.ra_drive)
        advance(samples, *ranges, *drives, self._constants, self._state, out, trace)


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
        self._stream = _Stream(self._lanes(), parameters)
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
        self._stream.lanes = self._lanes()

    @property
    def clipped(self) -> NDArray[np.int64]:
        """Readings outside the range so far, for each taxel, int64 (n_taxels,)."""
        return self._clipped.copy()

    def reset(self) -> None:
        """Neurons to rest; the filter starts at the next sample."""
        self._stream.reset()

    def warm(self) -> None:
        """Have the kernel compiled before time matters; state and counts stay untouched."""
        scratch = _Stream(self._stream.lanes, self.parameters)
        scratch.counts(np.zeros((1, self._normalisation.n_taxels), np.uint16))

    def encode(self, samples: Samples) -> Counts:
        """Spikes of each sample: uint16 (n, n_taxels) → uint8 (n, 2·n_taxels), SA then RA.

        Raises :class:`WrongUse` for another number of taxels.
        """
        _check(samples, self._normalisation)
        self._clipped += self._normalisation.clipped(samples)
        return self._stream.counts(samples)

    def _lanes(self) -> _Lanes:
        ones = np.ones((1, self._normalisation.n_taxels))
        return _Lanes.of(self._normalisation, self.parameters, ones)


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

    ``trials``: uint16 (n_i, n_taxels) each. ``sa_scale``: float64 (n_trials, n_taxels), a factor
    on the SA current of each trial and taxel (the force matrix C), or None for 1 everywhere.
    """
    spikes: dict[int, Spikes] = {}
    for chosen, counts in _tiles(trials, normalisation, parameters, sa_scale):
        lengths = [len(trials[i]) for i in chosen]
        trains = raster.to_spikes(counts, lengths, normalisation.n_taxels)
        spikes.update(zip(chosen, trains, strict=True))
    return [spikes[i] for i in range(len(trials))]


def rasters(
    trials: Sequence[Samples],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    sa_scale: NDArray[np.float64] | None = None,
) -> Iterator[tuple[int, int, Counts]]:
    """Each trial's place in an encoded tile: (index, first lane, counts uint8 (n, 2·lanes)).

    Trials come in order of their length. SA taxel i of the trial is column ``first lane + i``,
    RA the same plus half the columns; rows past the trial's own length are filling. The counts
    are overwritten when the next trial is asked for.
    """
    for chosen, counts in _tiles(trials, normalisation, parameters, sa_scale):
        for place, index in enumerate(chosen):
            yield index, place * normalisation.n_taxels, counts


def _tiles(
    trials: Sequence[Samples],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    sa_scale: NDArray[np.float64] | None,
) -> Iterator[tuple[list[int], Counts]]:
    """Trials that were encoded side by side, by index, and their raster, in one memory for all."""
    for samples in trials:
        _check(samples, normalisation)
    if sa_scale is None:
        sa_scale = np.ones((len(trials), normalisation.n_taxels))
    # Neighbours in length share a tile, so that little is computed for nothing.
    order = sorted(range(len(trials)), key=lambda i: (len(trials[i]), i))
    per_tile = max(1, TILE_LANES // normalisation.n_taxels)
    # Fresh memory for each tile would cost a fifth of the time in page faults.
    most = per_tile * normalisation.n_taxels * max(map(len, trials), default=0)
    readings, spikes = np.empty(most, np.uint16), np.empty(2 * most, np.uint8)
    for start in range(0, len(order), per_tile):
        chosen = order[start : start + per_tile]
        lanes = _Lanes.of(normalisation, parameters, sa_scale[chosen])
        shape = (len(trials[chosen[-1]]), len(chosen) * normalisation.n_taxels)
        tile = readings[: shape[0] * shape[1]].reshape(shape)
        counts = spikes[: 2 * tile.size].reshape(shape[0], 2 * shape[1])
        raster.lay_side_by_side([trials[i] for i in chosen], tile)
        yield chosen, _Stream(lanes, parameters).counts(tile, counts)


def membrane_mv(
    samples: Samples, normalisation: Normalisation, parameters: EncoderParameters = DEFAULT
) -> NDArray[np.float64]:
    """Membrane voltage after each sample, float64 (n, 2·n_taxels) in mV, SA then RA.

    Started at rest. A sample with a spike shows the threshold, as such curves are drawn.
    """
    _check(samples, normalisation)
    ones = np.ones((1, normalisation.n_taxels))
    return _Stream(_Lanes.of(normalisation, parameters, ones), parameters).membrane_mv(samples)
