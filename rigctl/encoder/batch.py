"""Count the spikes of many trials in time bins, without storing trains or rasters.

A bin is the time between two bin edges. Every window boundary of every feature layout is a bin
edge, so counts in bins hold all that every feature needs, in a fraction of the memory: about 40
bins for the paper's 60 and 20 windows together.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import tiles
from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.kernel import (
    NeuronBlocks,
    Trials,
    TrialViews,
    accumulate_bins,
    max_samples_per_row,
    scatter_to_trials,
    trial_readings,
)
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse

Counts = NDArray[np.uint32]
Floats = NDArray[np.float64]
READING_STRIDE = 16
"""Every 16th sample contributes to the mean reading."""


def common_bin_edges(
    layouts: Sequence[FeatureLayout], n_samples: int, speed_mm_s: float
) -> NDArray[Any]:
    """Return the bin edges that all layouts share at one speed, int64 (n_bins + 1,), in samples.

    ``n_samples``: of the longest trial. Samples behind a layout's last window belong to bins too,
    so that the counts of a trial add up to all of its spikes.
    """
    starts = np.concatenate([layout.window_starts(speed_mm_s) for layout in layouts])
    return np.unique([0, *starts[starts < n_samples], n_samples])


def single_bin_edges(trials: Trials) -> NDArray[np.int64]:
    """Return the edges of one bin that holds every trial whole."""
    return np.array([0, TrialViews.from_arrays(trials).lengths.max(initial=0)])


def count_spikes(
    trials: Trials,
    bin_edges: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: Floats | None = None,
    taxels: NDArray[np.int64] | None = None,
    sa_only: bool = False,
) -> Counts:
    """Return the spikes in each bin, uint32 (n_trials, n_trains, n_bins); SA trains, then RA.

    ``trials``: uint16 (n_i, n_taxels) each, none longer than the last edge. ``taxels``: the taxels
    to encode (default all). ``sa_scale``: float64 (n_trials, encoded taxels), a factor on the SA
    current.

    Raises :class:`WrongUse` for another number of taxels, longer trials, or taxels that do not
    exist: the kernel reads memory by address.
    """
    variant = _Variant(sa_scale, sa_only)
    (counts,) = _count_variants(trials, bin_edges, normalisation, parameters, taxels, [variant])
    return counts


def count_spikes_without_and_with_c(
    trials: Trials,
    bin_edges: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    sa_scale: Floats,
) -> tuple[Counts, Counts]:
    """Return :func:`count_spikes` of both channels without C, and of SA alone with C."""
    variants = [_Variant(None, sa_only=False), _Variant(sa_scale, sa_only=True)]
    without, with_c = _count_variants(trials, bin_edges, normalisation, parameters, None, variants)
    return without, with_c


class _Variant(NamedTuple):
    """One way to encode the same readings; see :func:`count_spikes`."""

    sa_scale: Floats | None
    sa_only: bool


def _count_variants(
    trials: Trials,
    bin_edges: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    taxels: NDArray[np.int64] | None,
    variants: Sequence[_Variant],
) -> list[Counts]:
    """Return the counts of each variant, uint32 (n_trials, n_trains, n_bins)."""
    normalisation.check_reading(parameters)
    if taxels is None:
        taxels = np.arange(normalisation.n_taxels)
    views = TrialViews.from_arrays(trials)
    _check(views, bin_edges, normalisation.n_taxels, taxels)
    common = (views, bin_edges, normalisation, parameters, taxels)
    if not parameters.filters_whole_trials or all(variant.sa_only for variant in variants):
        return _count_by_kernel(*common, variants)
    # Imported here: SciPy's filters take a second to load, and only these presets need them.
    from rigctl.encoder.ra_neurons import count_ra_spikes

    ra, sa = count_ra_spikes(*common), [variant._replace(sa_only=True) for variant in variants]
    found = zip(_count_by_kernel(*common, sa), variants, strict=True)
    return [one if sa_only else np.concatenate([one, ra], axis=1) for one, (_, sa_only) in found]


def _count_by_kernel(
    views: TrialViews,
    bin_edges: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    taxels: NDArray[np.int64],
    variants: Sequence[_Variant],
) -> list[Counts]:
    """Return the counts of each variant as the kernel computes them."""
    n_bins = len(bin_edges) - 1
    n_trains = [len(taxels) if variant.sa_only else 2 * len(taxels) for variant in variants]
    outs = [np.empty((len(views), n, n_bins), np.uint32) for n in n_trains]
    edges, max_samples = tuple(bin_edges.tolist()), max_samples_per_row(parameters)
    for selected in tiles(views.lengths.tolist(), len(taxels)):
        tile = views.select(selected)
        rows = _kernel_rows(edges, tuple(sorted(set(tile.lengths.tolist()))), max_samples)
        for (sa_scale, sa_only), out in zip(variants, outs, strict=True):
            blocks = NeuronBlocks(
                len(selected),
                normalisation,
                parameters,
                None if sa_scale is None else sa_scale[selected],
                taxels=taxels,
                sa_only=sa_only,
            )
            scatter_to_trials(_tile_counts(blocks, tile, rows, n_bins), np.array(selected), out)
    return outs


def _check(
    views: TrialViews, bin_edges: NDArray[np.int64], n_taxels: int, taxels: NDArray[np.int64]
) -> None:
    _check_taxels(views, n_taxels)
    longest = views.lengths.max(initial=0)
    if longest > bin_edges[-1]:
        raise WrongUse(f"a trial has {longest} samples, but the last bin edge is {bin_edges[-1]}")
    if not set(taxels.tolist()) <= set(range(n_taxels)):
        raise WrongUse(f"taxels {taxels.tolist()} are not all within 0 to {n_taxels - 1}")


def _check_taxels(views: TrialViews, n_taxels: int) -> None:
    if len(views) and views.n_taxels != n_taxels:
        raise WrongUse(f"samples have {views.n_taxels} taxels, but the ranges have {n_taxels}")


class _KernelRows(NamedTuple):
    """Rows that the kernel counts: first sample of each, its end, and its bin."""

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    bins: NDArray[np.int64]


# A search needs the same few again and again.
@lru_cache(maxsize=64)
def _kernel_rows(edges: tuple[int, ...], lengths: tuple[int, ...], max_samples: int) -> _KernelRows:
    """Return the rows for trials of these lengths side by side, ``max_samples`` each at most.

    No row contains a bin edge or a trial's end.
    """
    inside = (edge for edge in edges if edge < lengths[-1])
    bounds = sorted({0, *inside, *lengths})
    rows = [t for a, b in pairwise(bounds) for t in range(a, b, max_samples)]
    starts, ends = np.array(rows, np.int64), np.array([*rows, lengths[-1]][1:], np.int64)
    return _KernelRows(starts, ends, np.searchsorted(edges, starts, side="right") - 1)


def _tile_counts(blocks: NeuronBlocks, tile: TrialViews, rows: _KernelRows, n_bins: int) -> Counts:
    """Return the spikes of a tile lane by lane, uint32 (blocks, bins, channels, block lanes)."""
    lengths = blocks.pad(np.repeat(tile.lengths, blocks.n_taxels))
    bins = np.zeros_like(blocks.empty_counts(n_bins), np.uint32)
    accumulate_bins(blocks.advance(tile, rows.ends), rows.starts, rows.bins, lengths, bins)
    return bins


def sa_rates_hz(counts: Counts, n_samples: Sequence[int], parameters: EncoderParameters) -> Floats:
    """Return the mean SA rate of each taxel over trials, float64 (n_taxels,), from SA counts.

    Rates are added in the order of the trials' lengths, as
    :func:`rigctl.encoder.force_search.mean_sa_rates_hz` does, so that both give the same bits.
    """
    lengths = np.maximum(1, n_samples)
    total = np.zeros(counts.shape[1])
    order = np.argsort(n_samples, kind="stable")
    _add_rates_compiled(counts, order, parameters.sample_rate_hz / lengths, total)
    return total / len(order)


def mean_normalised_reading(trials: Trials, normalisation: Normalisation) -> Floats:
    """Return the mean normalised reading of each taxel, float64 (n_taxels,): a start for C.

    The mean is over every 16th sample.
    """
    return normalise_mean_readings(mean_readings(trials, normalisation), normalisation)


def mean_readings(trials: Trials, normalisation: Normalisation) -> Floats:
    """Return the mean of every 16th reading, clipped to the range, float64 (n_trials, n_taxels).

    Raises :class:`WrongUse` for another number of taxels.
    """
    views = TrialViews.from_arrays(trials)
    _check_taxels(views, normalisation.n_taxels)
    sums = np.zeros((len(views), normalisation.n_taxels), np.int64)
    limits = (normalisation.low, normalisation.high)
    _sum_readings_compiled(views.addresses, views.lengths, *limits, READING_STRIDE, sums)
    means: Floats = sums / -(-views.lengths // READING_STRIDE)[:, None]
    return means


def normalise_mean_readings(means: Floats, normalisation: Normalisation) -> Floats:
    """Return the normalised mean of (some) rows of :func:`mean_readings`, float64 (n_taxels,)."""
    mean: Floats = np.mean(means, axis=0)
    return (mean - normalisation.low.astype(np.float64)) * normalisation.scale


def features_from_counts(
    counts: NDArray[Any],
    bin_edges: NDArray[np.int64],
    n_samples: Sequence[int],
    speed_mm_s: float,
    layout: FeatureLayout,
) -> Floats:
    """Return the feature vectors of SA and RA counts in bins, float64 (n_trials, n_features).

    Equal to :func:`rigctl.encoder.features.trial_features` of each trial's spikes.
    """
    window_of_bin = _bin_windows(layout, bin_edges, speed_mm_s)
    durations_s = layout.window_durations_s(n_samples, speed_mm_s)
    out = np.empty((len(counts), counts.shape[1] * layout.n_windows))
    _fill_features_compiled(counts, window_of_bin, durations_s, out)
    return out


def window_counts(
    counts: NDArray[Any], bin_edges: NDArray[np.int64], speed_mm_s: float, layout: FeatureLayout
) -> NDArray[np.uint32]:
    """Return the spikes in each window, uint32 (n_trials, n_trains, n_windows), from bin counts."""
    window_of_bin = _bin_windows(layout, bin_edges, speed_mm_s)
    out = np.zeros((*counts.shape[:2], layout.n_windows + 1), np.uint32)
    firsts = np.flatnonzero(np.diff(window_of_bin, prepend=-1))
    out[:, :, window_of_bin[firsts]] = np.add.reduceat(counts, firsts, axis=2, dtype=np.uint32)
    return out[:, :, : layout.n_windows]


def _bin_windows(
    layout: FeatureLayout, bin_edges: NDArray[np.int64], speed_mm_s: float
) -> NDArray[np.int64]:
    """Return the window of each bin; bins behind the last window share an extra one."""
    return np.searchsorted(layout.window_starts(speed_mm_s), bin_edges[:-1], side="right") - 1


def _add_rates(counts: Any, order: Any, hz_per_spike: Any, total: Any) -> None:
    """Add up the rate of each train (trials, trains, bins), trial after trial in ``order``."""
    for i in order:
        for train in range(counts.shape[1]):
            total[train] += counts[i, train].sum() * hz_per_spike[i]


def _sum_readings(addresses: Any, lengths: Any, low: Any, high: Any, stride: Any, out: Any) -> None:
    """Sum up every ``stride``-th reading, clipped to the range, int64 (trials, taxels)."""
    for i in range(len(addresses)):
        samples = trial_readings(addresses[i], lengths[i], out.shape[1])
        for t in range(0, lengths[i], stride):
            for j in range(out.shape[1]):
                out[i, j] += min(max(samples[t, j], low[j]), high[j])


def _fill_features(counts: Any, window_of_bin: Any, durations_s: Any, out: Any) -> None:
    """Turn counts in bins into feature vectors: SA rates in Hz, RA counts."""
    n, trains, bins = counts.shape
    windows = durations_s.shape[1]
    for i in range(n):
        for train in range(trains):
            first = train * windows
            for w in range(windows):
                out[i, first + w] = 0.0
            for b in range(bins):
                if window_of_bin[b] < windows:
                    out[i, first + window_of_bin[b]] += counts[i, train, b]
            if 2 * train < trains:
                for w in range(windows):
                    if durations_s[i, w] > 0.0:
                        out[i, first + w] /= durations_s[i, w]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_add_rates_compiled = _compile(_add_rates)
_sum_readings_compiled = _compile(_sum_readings)
_fill_features_compiled = _compile(_fill_features)
