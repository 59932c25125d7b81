"""Spikes of many trials counted in stretches of time, with no trains or rasters kept.

A stretch is the time between two cuts, and no window of any layout has a cut inside. So counts in
stretches hold all that every feature needs, in a fraction of the memory: some 40 stretches for the
paper's 60 and 20 windows together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.encoding import kernel
from rigctl.encoding.encoder import TILE_LANES
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.presets import DEFAULT, EncoderParameters

Samples = NDArray[np.uint16]
Counts = NDArray[np.uint32]
LEVEL_EVERY = 16
"""Every so many samples enter the mean reading."""


def cuts_of(layouts: Sequence[FeatureLayout], n_samples: int, speed_mm_s: float) -> NDArray[Any]:
    """First sample of each stretch of trials at one speed and the end, int64 (n_stretches + 1,).

    ``n_samples``: of the longest trial. What lies behind a layout's last window belongs to
    stretches too, so that a trial's counts sum up to all of its spikes.
    """
    changes = [
        np.flatnonzero(np.diff(_windows(layout, n_samples, speed_mm_s))) + 1 for layout in layouts
    ]
    return np.unique(np.concatenate([[0, n_samples], *changes])).astype(np.int64)


def whole_trials(trials: Sequence[Samples]) -> NDArray[np.int64]:
    """Cuts of one stretch that holds all of each trial."""
    return np.array([0, max(map(len, trials), default=0)])


def stretch_counts(
    trials: Sequence[Samples],
    cuts: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
    taxels: NDArray[np.int64] | None = None,
    sa_only: bool = False,
) -> Counts:
    """Spikes in each stretch, uint32 (n_trials, n_trains, n_stretches); SA trains, then RA.

    ``trials``: contiguous uint16 (n_i, n_taxels) each, none longer than the last cut. ``taxels``:
    which of them are encoded (all). ``sa_scale``: float64 (n_trials, taxels that are encoded).
    """
    if taxels is None:
        taxels = np.arange(normalisation.n_taxels)
    if sa_scale is None:
        sa_scale = np.ones((len(trials), len(taxels)))
    channels = 1 if sa_only else 2
    out = np.empty((len(trials), channels * len(taxels), len(cuts) - 1), np.uint32)
    for chosen, counts in _tiles(trials, normalisation, parameters, sa_scale, taxels):
        lengths = np.array([len(trials[i]) for i in chosen])
        in_tile = np.empty((len(cuts) - 1, counts.shape[1]), np.uint32)
        _count_compiled(counts, np.tile(np.repeat(lengths, len(taxels)), 2), cuts, in_tile)
        by_trial = in_tile.reshape(len(in_tile), 2, len(chosen), len(taxels))[:, :channels]
        out[chosen] = by_trial.transpose(2, 1, 3, 0).reshape(len(chosen), -1, len(in_tile))
    return out


def _tiles(
    trials: Sequence[Samples],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    sa_scale: NDArray[np.float64],
    taxels: NDArray[np.int64],
) -> Iterator[tuple[list[int], NDArray[np.uint8]]]:
    """Trials that were encoded side by side, by index, and their raster, in one memory for all."""
    order = sorted(range(len(trials)), key=lambda i: (len(trials[i]), i))
    per_tile = max(1, TILE_LANES // len(taxels))
    most = per_tile * len(taxels) * max(map(len, trials), default=0)
    readings, spikes = np.empty(most, np.uint16), np.empty(2 * most, np.uint8)
    sa_drive, ra_drive = kernel.drives(parameters)
    constants, advance = kernel.folded(parameters), kernel.kernel_for(parameters)
    ranges = (normalisation.low[taxels], normalisation.high[taxels], normalisation.scale[taxels])
    for start in range(0, len(order), per_tile):
        chosen = order[start : start + per_tile]
        lanes = len(chosen) * len(taxels)
        shape = (len(trials[chosen[-1]]), lanes)
        tile = readings[: shape[0] * lanes].reshape(shape)
        counts = spikes[: 2 * tile.size].reshape(shape[0], 2 * lanes)
        for place, index in enumerate(chosen):
            # A trial without samples has nothing to fill its columns with.
            if not len(trials[index]):
                tile[:, place * len(taxels) : (place + 1) * len(taxels)] = 0
                continue
            _lay_compiled(trials[index], taxels, tile, place * len(taxels))
        of_lanes = [np.tile(part, len(chosen)) for part in ranges]
        if not len(tile):
            yield chosen, counts
            continue
        state = kernel.rest(parameters, lanes)
        kernel.start_filter(tile[0], *of_lanes, constants, state)
        drives = (sa_drive * sa_scale[chosen].reshape(-1), np.full(lanes, ra_drive))
        advance(tile, *of_lanes, *drives, constants, state, counts, np.empty((0, 2 * lanes)))
        yield chosen, counts


def sa_rates_hz(
    counts: Counts, n_samples: Sequence[int], parameters: EncoderParameters
) -> NDArray[np.float64]:
    """Mean SA rate of each taxel over trials, float64 (n_taxels,), of their SA counts.

    Summed up in the order of the trials' lengths, as
    :func:`rigctl.encoding.force.mean_sa_rates_hz` does, so that both give the same bits.
    """
    order = sorted(range(len(n_samples)), key=lambda i: (n_samples[i], i))
    per_spike = np.array([parameters.sample_rate_hz / max(1, n_samples[i]) for i in order])
    terms = counts.sum(axis=2)[order] * per_spike[:, None]
    total: NDArray[np.float64] = np.add.accumulate(terms, axis=0)[-1] / len(order)
    return total


def mean_level(trials: Sequence[Samples], normalisation: Normalisation) -> NDArray[np.float64]:
    """Mean normalised reading of each taxel over some of the samples, float64: a start for C."""
    sums = np.zeros((len(trials), normalisation.n_taxels))
    for samples, row in zip(trials, sums, strict=True):
        _level_compiled(samples, normalisation.low, normalisation.high, LEVEL_EVERY, row)
    used = np.array([-(-len(samples) // LEVEL_EVERY) for samples in trials])
    level: NDArray[np.float64] = np.mean(sums / used[:, None], axis=0)
    return (level - normalisation.low.astype(np.float64)) * normalisation.scale


def features_of(
    counts: NDArray[Any],
    cuts: NDArray[np.int64],
    n_samples: Sequence[int],
    speed_mm_s: float,
    layout: FeatureLayout,
) -> NDArray[np.float64]:
    """Feature vectors, float64 (n_trials, width), of SA and RA counts in stretches.

    Equal to :func:`rigctl.encoding.features.trial_features` of each trial's spikes.
    """
    window_of = _windows(layout, int(cuts[-1]), speed_mm_s)[cuts[:-1]]
    seconds = np.empty((len(counts), layout.n_windows))
    for n in set(n_samples):
        held = layout.seconds_in_windows(layout.windows(n, speed_mm_s))
        seconds[[i for i, m in enumerate(n_samples) if m == n]] = held
    out = np.zeros((len(counts), counts.shape[1] * layout.n_windows))
    _features_compiled(counts, window_of, seconds, out)
    return out


def window_counts(
    counts: NDArray[Any], cuts: NDArray[np.int64], speed_mm_s: float, layout: FeatureLayout
) -> NDArray[np.uint32]:
    """Spikes in each window, uint32 (n_trials, n_trains, n_windows), of counts in stretches."""
    window_of = _windows(layout, int(cuts[-1]), speed_mm_s)[cuts[:-1]]
    out = np.zeros((*counts.shape[:2], layout.n_windows + 1), np.uint32)
    firsts = np.flatnonzero(np.diff(window_of, prepend=-1))
    out[:, :, window_of[firsts]] = np.add.reduceat(counts, firsts, axis=2, dtype=np.uint32)
    return out[:, :, : layout.n_windows]


def _windows(layout: FeatureLayout, n_samples: int, speed_mm_s: float) -> NDArray[np.int64]:
    """Window of each sample; all behind the last window are in one of their own."""
    return np.minimum(layout.windows(n_samples, speed_mm_s), layout.n_windows)


def _lay(samples: Any, taxels: Any, tile: Any, first: Any) -> None:
    """Copy some taxels of a trial into the tile's columns; its last row fills the rest."""
    n = samples.shape[0]
    for t in range(tile.shape[0]):
        row = samples[min(t, n - 1)]
        for j in range(taxels.shape[0]):
            tile[t, first + j] = row[taxels[j]]


def _count(counts: Any, lengths: Any, cuts: Any, out: Any) -> None:
    """Sum a raster up: uint8 (n, columns), of which ``lengths`` rows are a column's own."""
    columns = counts.shape[1]
    shortest = lengths.min()
    sums = np.zeros(columns, np.uint32)
    for stretch in range(out.shape[0]):
        for c in range(columns):
            sums[c] = 0
        for t in range(cuts[stretch], min(cuts[stretch + 1], shortest)):
            row = counts[t]
            for c in range(columns):
                sums[c] += np.uint32(row[c])
        for t in range(max(cuts[stretch], shortest), min(cuts[stretch + 1], counts.shape[0])):
            for c in range(columns):
                if t < lengths[c]:
                    sums[c] += np.uint32(counts[t, c])
        for c in range(columns):
            out[stretch, c] = sums[c]


def _level(samples: Any, low: Any, high: Any, every: Any, out: Any) -> None:
    """Sum of some samples cut off at the ends of the range: whole numbers, so exact."""
    for t in range(0, samples.shape[0], every):
        for j in range(samples.shape[1]):
            out[j] += min(max(samples[t, j], low[j]), high[j])


def _features(counts: Any, window_of: Any, seconds: Any, out: Any) -> None:
    """Counts in stretches to feature vectors: SA rates in Hz, RA counts; ``out`` holds zeros."""
    n, trains, stretches = counts.shape
    windows = seconds.shape[1]
    for i in range(n):
        for train in range(trains):
            first = train * windows
            for s in range(stretches):
                if window_of[s] < windows:
                    out[i, first + window_of[s]] += counts[i, train, s]
            if 2 * train < trains:
                for w in range(windows):
                    if seconds[i, w] > 0.0:
                        out[i, first + w] /= seconds[i, w]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_lay_compiled = _compile(_lay)
_count_compiled = _compile(_count)
_level_compiled = _compile(_level)
_features_compiled = _compile(_features)
