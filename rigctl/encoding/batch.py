"""Spikes of many trials counted in stretches of time, with no trains or rasters kept.

A stretch is the time between two cuts, and no window of any layout has a cut inside. So counts in
stretches hold all that every feature needs, in a fraction of the memory: some 40 stretches for the
paper's 60 and 20 windows together.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.encoder import tiles
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.kernel import constants, raster
from rigctl.encoding.kernel.machine_code import LANES, LANES_OF_SA
from rigctl.encoding.kernel.neuron_blocks import NeuronBlocks
from rigctl.encoding.kernel.prefetch import BYTES, TrialRows, Trials, readings_of
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse

Samples = NDArray[np.uint16]
Counts = NDArray[np.uint32]
LEVEL_EVERY = 16
"""Every so many samples enter the mean reading."""


def cuts_of(layouts: Sequence[FeatureLayout], n_samples: int, speed_mm_s: float) -> NDArray[Any]:
    """First sample of each stretch of trials at one speed and the end, int64 (n_stretches + 1,).

    ``n_samples``: of the longest trial. What lies behind a layout's last window belongs to
    stretches too, so that a trial's counts sum up to all of its spikes.
    """
    begins = np.concatenate([layout.begins(speed_mm_s) for layout in layouts])
    return np.unique([0, *begins[begins < n_samples], n_samples])


def whole_trials(trials: Trials) -> NDArray[np.int64]:
    """Cuts of one stretch that holds all of each trial."""
    return np.array([0, TrialRows.of(trials).lengths.max(initial=0)])


def stretch_counts(
    trials: Trials,
    cuts: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
    taxels: NDArray[np.int64] | None = None,
    sa_only: bool = False,
) -> Counts:
    """Spikes in each stretch, uint32 (n_trials, n_trains, n_stretches); SA trains, then RA.

    ``trials``: uint16 (n_i, n_taxels) each, none longer than the last cut. ``taxels``:
    which of them are encoded (all). ``sa_scale``: float64 (n_trials, taxels that are encoded).

    Raises :class:`WrongUse` for another number of taxels, longer trials, or taxels that there are
    not: the kernel reads memory by address.
    """
    way = _EncodingVariant(sa_scale, sa_only)
    (counts,) = _counts_of_ways(trials, cuts, normalisation, parameters, taxels, [way])
    return counts


def counts_without_and_with(
    trials: Trials,
    cuts: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    sa_scale: NDArray[np.float64],
) -> tuple[Counts, Counts]:
    """:func:`stretch_counts` of both channels without C, and of SA alone with it."""
    ways = [_EncodingVariant(None, sa_only=False), _EncodingVariant(sa_scale, sa_only=True)]
    without, with_c = _counts_of_ways(trials, cuts, normalisation, parameters, None, ways)
    return without, with_c


class _EncodingVariant(NamedTuple):
    """How the same readings are encoded; as :func:`stretch_counts` is told."""

    sa_scale: NDArray[np.float64] | None
    sa_only: bool

    @property
    def wide(self) -> int:
        """Lanes of a block."""
        return LANES_OF_SA if self.sa_only else LANES

    @property
    def channels(self) -> int:
        """SA and RA, or SA alone."""
        return 1 if self.sa_only else 2


def _counts_of_ways(
    trials: Trials,
    cuts: NDArray[np.int64],
    normalisation: Normalisation,
    parameters: EncoderParameters,
    taxels: NDArray[np.int64] | None,
    ways: Sequence[_EncodingVariant],
) -> list[Counts]:
    """Counts of each way, uint32 (n_trials, n_trains, n_stretches)."""
    if taxels is None:
        taxels = np.arange(normalisation.n_taxels)
    n, some, between = len(trials), len(taxels), len(cuts) - 1
    outs = [np.empty((n, way.channels * some, between), np.uint32) for way in ways]
    rows, most = TrialRows.of(trials), constants.samples_per_row(parameters)
    _check(rows, cuts, normalisation.n_taxels, taxels)
    of_cuts = tuple(cuts.tolist())
    for chosen in tiles(rows.lengths.tolist(), some, max(way.wide for way in ways)):
        tile = rows.some(chosen)
        steps = _steps(of_cuts, tuple(sorted(set(tile.lengths.tolist()))), most)
        for way, out in zip(ways, outs, strict=True):
            sums = _sums(way, chosen, tile, steps, between, normalisation, parameters, taxels)
            raster.take_apart(sums, np.array(chosen), out)
    return outs


def _check(
    rows: TrialRows, cuts: NDArray[np.int64], n_taxels: int, taxels: NDArray[np.int64]
) -> None:
    _check_width(rows, n_taxels)
    if rows.lengths.max(initial=0) > cuts[-1]:
        raise WrongUse(f"a trial of {rows.lengths.max()} samples, the last cut at {cuts[-1]}")
    if not set(taxels.tolist()) <= set(range(n_taxels)):
        raise WrongUse(f"taxels {taxels.tolist()} of 0 to {n_taxels - 1}")


def _check_width(rows: TrialRows, n_taxels: int) -> None:
    if len(rows) and rows.row_bytes != BYTES * n_taxels:
        raise WrongUse(f"samples of {rows.row_bytes // BYTES} taxels, ranges of {n_taxels}")


class _Steps(NamedTuple):
    """Rows of the kernel: first sample of each, the one behind it, and whose spikes they are."""

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    stretches: NDArray[np.int64]


def _sums(
    way: _EncodingVariant,
    chosen: Sequence[int],
    tile: TrialRows,
    steps: _Steps,
    between: int,
    normalisation: Normalisation,
    parameters: EncoderParameters,
    taxels: NDArray[np.int64],
) -> Counts:
    """Spikes of some trials between cuts, lane by lane: (blocks, stretches, channels, wide)."""
    scale = None if way.sa_scale is None else way.sa_scale[chosen]
    blocks = NeuronBlocks.of_trials(
        len(chosen), normalisation, parameters, scale, taxels=taxels, sa_only=way.sa_only
    )
    in_lane = blocks.by_lane(np.repeat(tile.lengths, len(taxels)))
    sums = np.zeros_like(blocks.room_for(between), np.uint32)
    counts = blocks.advance(tile, steps.ends)
    raster.add_up(counts, steps.starts, steps.stretches, in_lane, sums)
    return sums


# A search asks for the same few again and again.
@lru_cache(maxsize=64)
def _steps(cuts: tuple[int, ...], lengths: tuple[int, ...], most: int) -> _Steps:
    """How trials of these lengths go through time side by side, in rows of ``most`` samples.

    No row holds a cut, a trial's end, or too much.
    """
    inside = (cut for cut in cuts if cut < lengths[-1])
    edges = sorted({0, *inside, *lengths})
    rows = [t for a, b in pairwise(edges) for t in range(a, b, most)]
    starts, ends = np.array(rows, np.int64), np.array([*rows, lengths[-1]][1:], np.int64)
    return _Steps(starts, ends, np.searchsorted(cuts, starts, side="right") - 1)


def sa_rates_hz(
    counts: Counts, n_samples: Sequence[int], parameters: EncoderParameters
) -> NDArray[np.float64]:
    """Mean SA rate of each taxel over trials, float64 (n_taxels,), of their SA counts.

    Summed up in the order of the trials' lengths, as
    :func:`rigctl.encoding.force_search.mean_sa_rates_hz` does, so that both give the same bits.
    """
    lengths = np.maximum(1, n_samples)
    total = np.zeros(counts.shape[1])
    order = np.argsort(n_samples, kind="stable")
    _rates_compiled(counts, order, parameters.sample_rate_hz / lengths, total)
    return total / len(order)


def mean_level(trials: Trials, normalisation: Normalisation) -> NDArray[np.float64]:
    """Mean normalised reading of each taxel over some of the samples, float64: a start for C."""
    return mean_of_levels(levels_of(trials, normalisation), normalisation)


def levels_of(trials: Trials, normalisation: Normalisation) -> NDArray[np.float64]:
    """Mean reading of each trial and taxel over some of the samples, cut off at the range's ends.

    float64 (n_trials, n_taxels). Raises :class:`WrongUse` for another number of taxels.
    """
    rows = TrialRows.of(trials)
    _check_width(rows, normalisation.n_taxels)
    sums = np.zeros((len(rows), normalisation.n_taxels), np.int64)
    ends = (normalisation.low, normalisation.high)
    _level_compiled(rows.addresses, rows.lengths, *ends, LEVEL_EVERY, sums)
    levels: NDArray[np.float64] = sums / -(-rows.lengths // LEVEL_EVERY)[:, None]
    return levels


def mean_of_levels(
    levels: NDArray[np.float64], normalisation: Normalisation
) -> NDArray[np.float64]:
    """Of what :func:`levels_of` gives, or of some of its rows: normalised, float64 (n_taxels,)."""
    level: NDArray[np.float64] = np.mean(levels, axis=0)
    return (level - normalisation.low.astype(np.float64)) * normalisation.scale


def features_of(
    counts: NDArray[Any],
    cuts: NDArray[np.int64],
    n_samples: Sequence[int],
    speed_mm_s: float,
    layout: FeatureLayout,
    out: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Feature vectors, float64 (n_trials, width), of SA and RA counts in stretches.

    Equal to :func:`rigctl.encoding.features.trial_features` of each trial's spikes. In ``out``
    where it is given.
    """
    window_of = _windows(layout, cuts, speed_mm_s)
    seconds = layout.seconds(n_samples, speed_mm_s)
    if out is None:
        out = np.empty((len(counts), counts.shape[1] * layout.n_windows))
    _features_compiled(counts, window_of, seconds, out)
    return out


def window_counts(
    counts: NDArray[Any], cuts: NDArray[np.int64], speed_mm_s: float, layout: FeatureLayout
) -> NDArray[np.uint32]:
    """Spikes in each window, uint32 (n_trials, n_trains, n_windows), of counts in stretches."""
    window_of = _windows(layout, cuts, speed_mm_s)
    out = np.zeros((*counts.shape[:2], layout.n_windows + 1), np.uint32)
    firsts = np.flatnonzero(np.diff(window_of, prepend=-1))
    out[:, :, window_of[firsts]] = np.add.reduceat(counts, firsts, axis=2, dtype=np.uint32)
    return out[:, :, : layout.n_windows]


def _windows(
    layout: FeatureLayout, cuts: NDArray[np.int64], speed_mm_s: float
) -> NDArray[np.int64]:
    """Window of each stretch; all behind the last window are in one of their own."""
    return np.searchsorted(layout.begins(speed_mm_s), cuts[:-1], side="right") - 1


def _rates(counts: Any, order: Any, per_spike: Any, total: Any) -> None:
    """Add up the rates of each train (trials, trains, stretches), trial after trial in order."""
    for i in order:
        for train in range(counts.shape[1]):
            total[train] += counts[i, train].sum() * per_spike[i]


def _level(addresses: Any, lengths: Any, low: Any, high: Any, every: Any, out: Any) -> None:
    """Sum of some samples cut off at the ends of the range, int64 (trials, taxels)."""
    for i in range(len(addresses)):
        samples = readings_of(addresses[i], lengths[i], out.shape[1])
        for t in range(0, lengths[i], every):
            for j in range(out.shape[1]):
                out[i, j] += min(max(samples[t, j], low[j]), high[j])


def _features(counts: Any, window_of: Any, seconds: Any, out: Any) -> None:
    """Counts in stretches to feature vectors: SA rates in Hz, RA counts."""
    n, trains, stretches = counts.shape
    windows = seconds.shape[1]
    for i in range(n):
        for train in range(trains):
            first = train * windows
            for w in range(windows):
                out[i, first + w] = 0.0
            for s in range(stretches):
                if window_of[s] < windows:
                    out[i, first + window_of[s]] += counts[i, train, s]
            if 2 * train < trains:
                for w in range(windows):
                    if seconds[i, w] > 0.0:
                        out[i, first + w] /= seconds[i, w]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_rates_compiled = _compile(_rates)
_level_compiled = _compile(_level)
_features_compiled = _compile(_features)
