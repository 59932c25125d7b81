"""Measure what lost samples do to the rates of a session's trials, held or started anew.

``python -m tools.lost_samples SESSION`` takes samples away from whole trials, in runs of one to
three, and encodes what is left twice: with each lost sample replaced by the one before it, and
starting anew from rest after each gap. It prints the errors of rates against the whole trial.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import encode_trial, encode_trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.session import Session
from rigctl.values import SAMPLE_RATE_HZ, Spikes

LOST_SHARES = (0.001, 0.0033, 0.01, 0.03)
RUNS = (1, 2, 3, 10)
TRIALS = 24
MIN_HZ = 2.0
"""Trains with a lower rate have too few spikes for an error in per cent."""

Samples = NDArray[np.uint16]


def received(n: int, share: float, run: int, random: np.random.Generator) -> NDArray[np.intp]:
    """Return the rows that arrive where this share is lost in runs of this length."""
    lost = np.zeros(n, bool)
    for start in random.integers(1, n - run, round(share * n / run)):
        lost[start : start + run] = True
    return np.flatnonzero(~lost)


def rates(trains: list[Spikes], n_taxels: int, n: int) -> NDArray[np.float64]:
    """Return the mean rate of each train over pieces of a trial, Hz."""
    counts = [[len(one.train(row)) for row in range(2 * n_taxels)] for one in trains]
    hz: NDArray[np.float64] = np.sum(counts, axis=0) * (SAMPLE_RATE_HZ / n)
    return hz


def errors(trials: list[Samples], ranges: Normalisation, share: float, run: int) -> Iterator[str]:
    """Yield the errors of both ways for SA and RA, in per cent."""
    random = np.random.default_rng(1)
    n_taxels = ranges.n_taxels
    found: dict[str, list[NDArray[np.float64]]] = {"held": [], "anew": []}
    for samples in trials:
        n = len(samples)
        rows = received(n, share, run, random)
        held = samples[rows[np.searchsorted(rows, np.arange(n), side="right") - 1]]
        cuts = [0, *(np.flatnonzero(np.diff(rows) > 1) + 1).tolist(), len(rows)]
        pieces = [np.ascontiguousarray(samples[rows[a:b]]) for a, b in pairwise(cuts)]
        whole = rates([encode_trial(samples, ranges)], n_taxels, n)
        of = {"held": [encode_trial(held, ranges)], "anew": encode_trials(pieces, ranges)}
        for way, trains in of.items():
            error = 100 * (rates(trains, n_taxels, n) / np.maximum(whole, 1e-9) - 1)
            found[way].append(np.where(whole >= MIN_HZ, error, np.nan))
    for way, values in found.items():
        table = np.array(values)
        for name, part in (("SA", table[:, :n_taxels]), ("RA", table[:, n_taxels:])):
            mean, worst = np.nanmean(part), np.nanpercentile(np.abs(part), 99)
            yield f"{way} {name} {mean:+6.2f} % (99 % within {worst:5.2f})"


def main(path: Path) -> None:
    """Print a line for each share of lost samples and each length of a gap."""
    with Session.open(path) as session:
        chosen = session.committed()[:: max(1, len(session.committed()) // TRIALS)]
        trials = [np.ascontiguousarray(session.window(int(i)).samples) for i in chosen]
    every = np.concatenate(trials)
    ranges = Normalisation(every.min(axis=0), every.max(axis=0))
    for share in LOST_SHARES:
        for run in RUNS:
            found = "; ".join(errors(trials, ranges, share, run))
            print(f"{100 * share:4.2f} % lost, {run:2} in a row: {found}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
