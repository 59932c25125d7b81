"""Distances of spike trains: Victor and Purpura's, and van Rossum's, of many trials to each other.

Both are compiled, because all pairs of trials are needed: elephant's functions, which the tests
compare with, would take days for them (decision 48). Times are in ms. A trial has several trains;
Victor-Purpura distances of trains add up, van Rossum's are lengths in a space and add up squared.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class TrainTable(NamedTuple):
    """Spike trains of trials; those of train r of trial i are ``ms[ptr[i, r]:ptr[i, r + 1]]``.

    ``ms``: float64, ascending in each train; ``ptr``: int64 (n_trials, n_trains + 1).
    """

    ms: Floats
    ptr: NDArray[np.int64]

    @classmethod
    def of(cls, trials: Sequence[Sequence[Floats]]) -> TrainTable:
        """Return the table of trials with equally many trains each, in ms."""
        lengths = np.array([[len(train) for train in trains] for trains in trials], np.int64)
        ptr = np.zeros((len(trials), lengths.shape[1] + 1), np.int64)
        ends = np.cumsum(lengths).reshape(lengths.shape)
        ptr[:, 1:] = ends
        ptr[1:, 0] = ends[:-1, -1]
        each = [np.asarray(train, np.float64) for trains in trials for train in trains]
        return cls(np.concatenate([np.empty(0), *each]), ptr)


def victor_purpura(table: TrainTable, rows: range, shift_cost_per_ms: float) -> Floats:
    """Return the distances of some trials to all, float64 (len(rows), n_trials).

    A spike is added or removed at a cost of 1, and moved at ``shift_cost_per_ms`` a ms (Victor and
    Purpura 1996), which is above 0.
    """
    out = np.zeros((len(rows), len(table.ptr)))
    _victor_purpura_rows(table.ms, table.ptr, rows.start, shift_cost_per_ms, out)
    return out


def van_rossum(table: TrainTable, rows: range, time_constant_ms: float) -> Floats:
    """Return the distances of some trials to all, float64 (len(rows), n_trials).

    Spikes become exponentials with this time constant; one spike is 1 away from none (van Rossum
    2001, with the normalisation of elephant).
    """
    out = np.zeros((len(rows), len(table.ptr)))
    _van_rossum_rows(table.ms, table.ptr, rows.start, time_constant_ms, out)
    return np.sqrt(np.maximum(out, 0.0))


def _victor_purpura_pair(a: Any, b: Any, cost: Any, before: Any, row: Any) -> Any:
    """Return the distance of two trains.

    Spikes further apart than 2 / cost are never moved to each other, so there is a cheapest way in
    the order of time, which leaves only the pairs of prefixes whose ends are so close.
    """
    n, m, reach = len(a), len(b), 2.0 / cost
    if n == 0 or m == 0:
        return float(n + m)
    low = high = 0
    while high < m and b[high] <= a[0] + reach:
        high += 1
    for j in range(high + 1):
        before[j] = j
    for i in range(1, n + 1):
        last_low, last_high = low, high
        while low < m and b[low] < a[i - 1] - reach:
            low += 1
        if i == n:
            high = m
        else:
            while high < m and b[high] <= a[i] + reach:
                high += 1
        for j in range(low, high + 1):
            best = np.inf
            if last_low <= j <= last_high:
                best = before[j] + 1.0
            if j > low:
                best = min(best, row[j - 1] + 1.0)
            if last_low < j <= last_high + 1:
                best = min(best, before[j - 1] + cost * abs(a[i - 1] - b[j - 1]))
            row[j] = best
        for j in range(low, high + 1):
            before[j] = row[j]
    return before[m]


def _overlap(a: Any, b: Any, tau: Any) -> Any:
    """Return the sum of exp(-|x - y| / tau) over the spikes of two trains."""
    total = of_a = of_b = now = 0.0
    i = j = 0
    while i < len(a) or j < len(b):
        is_a = j == len(b) or (i < len(a) and a[i] <= b[j])
        at = a[i] if is_a else b[j]
        decay = np.exp((now - at) / tau)
        of_a, of_b, now = of_a * decay, of_b * decay, at
        if is_a:
            total, of_a, i = total + of_b, of_a + 1.0, i + 1
        else:
            total, of_b, j = total + of_a, of_b + 1.0, j + 1
    return total


_compile = numba.njit(cache=True, nogil=True)
_pair_compiled = _compile(_victor_purpura_pair)
_overlap_compiled = _compile(_overlap)


@_compile
def _victor_purpura_rows(ms: Any, ptr: Any, first: Any, cost: Any, out: Any) -> None:
    longest = 0
    for i in range(ptr.shape[0]):
        for r in range(ptr.shape[1] - 1):
            longest = max(longest, ptr[i, r + 1] - ptr[i, r])
    before, row = np.empty(longest + 1), np.empty(longest + 1)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for r in range(ptr.shape[1] - 1):
                a = ms[ptr[first + i, r] : ptr[first + i, r + 1]]
                b = ms[ptr[j, r] : ptr[j, r + 1]]
                out[i, j] += _pair_compiled(a, b, cost, before, row)


@_compile
def _van_rossum_rows(ms: Any, ptr: Any, first: Any, tau: Any, out: Any) -> None:
    own = np.zeros((ptr.shape[0], ptr.shape[1] - 1))
    for j in range(ptr.shape[0]):
        for r in range(ptr.shape[1] - 1):
            train = ms[ptr[j, r] : ptr[j, r + 1]]
            own[j, r] = _overlap_compiled(train, train, tau)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for r in range(ptr.shape[1] - 1):
                a = ms[ptr[first + i, r] : ptr[first + i, r + 1]]
                b = ms[ptr[j, r] : ptr[j, r + 1]]
                out[i, j] += own[first + i, r] + own[j, r] - 2.0 * _overlap_compiled(a, b, tau)
