"""Trains that differ between the kernel and the textbook's order, and what that moves.

``python -m tests.encoder.textbook_order SESSION`` prints the sentences of
``docs/reference/encoding.md``: trains of the default preset by the kernel, by the equations as they
are printed, and by the same equations with the polynomial factored, which equal each other but for
rounding; then accuracies of Original and Speed Scaled from the trains of each.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.tasks import SweepSettings, TaskResult, run_tasks
from rigctl.analysis.trial_set import TrialRef, join_sessions, open_trials
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import trial_features
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from rigctl.encoder.ra_filter import ra_signals
from rigctl.values import Spikes

Raster = NDArray[np.uint8]
PLAIN = ("original", "speed")
"""Representations without C."""


class Differences(NamedTuple):
    """Trains, and those that differ: kernel and printed order, printed and factored order.

    ``rates_hz``: of the trains that differ between kernel and printed order; ``sa``: how many of
    them are SA; ``forces_g``: those of their trials.
    """

    trains: int
    kernel: int
    orders: int
    sa: int
    rates_hz: list[float]
    forces_g: set[float]


def _printed(v: Any, u: Any, current: Any) -> Any:
    return 0.04 * (v * v) + 5.0 * v + 140.0 - u + current


def _factored(v: Any, u: Any, current: Any) -> Any:
    return (0.04 * v + 5.0) * v + ((140.0 - u) + current)


def _neurons(rise: Any) -> Callable[[NDArray[np.float64], Raster], None]:
    def respond(current: Any, spikes: Any) -> None:
        v, u = np.full(current.shape[1], -70.0), np.full(current.shape[1], -14.0)
        for t in range(current.shape[0]):
            for j in range(current.shape[1]):
                for _ in range(4):
                    v[j] += 0.25 * rise(v[j], u[j], current[t, j])
                    u[j] += 0.25 * 0.02 * (0.2 * v[j] - u[j])
                    if v[j] >= 30.0:
                        v[j], u[j] = -65.0, u[j] + 6.0
                        spikes[t, j] += 1

    compiled: Callable[[NDArray[np.float64], Raster], None] = numba.njit(respond)
    return compiled


printed, factored = (_neurons(numba.njit(rise)) for rise in (_printed, _factored))


def raster(
    respond: Callable[[NDArray[np.float64], Raster], None],
    samples: NDArray[np.uint16],
    ranges: Normalisation,
) -> Raster:
    """Return the spikes of all neurons by one order of operations, uint8 (n, 2 · n_taxels)."""
    x = ranges.apply(samples)
    current = np.hstack([DEFAULT.sa_gain * x, ra_signals(x, DEFAULT).current])
    spikes = np.zeros(current.shape, np.uint8)
    respond(current, spikes)
    return spikes


def as_spikes(of_trial: Raster) -> Spikes:
    """Return a raster as trains."""
    trains = [np.repeat(np.arange(len(row), dtype=np.int32), row) for row in of_trial.T]
    starts = np.concatenate([[0], np.cumsum([len(train) for train in trains])])
    return Spikes(starts, np.concatenate(trains), len(of_trial))


def compare(
    trials: Sequence[TrialRef], samples: Sequence[NDArray[np.uint16]], ranges: Normalisation
) -> Differences:
    """Return the trains that differ."""
    kernel = encode_trials(list(samples), ranges, DEFAULT)
    n = kernel_n = orders = sa = 0
    rates: list[float] = []
    forces: set[float] = set()
    for trial, readings, ours in zip(trials, samples, kernel, strict=True):
        first, second = (raster(respond, readings, ranges) for respond in (printed, factored))
        n, orders = n + first.shape[1], orders + int((first != second).any(axis=0).sum())
        spikes = as_spikes(first)
        for row in range(ours.n_trains):
            if not np.array_equal(ours.train(row), spikes.train(row)):
                kernel_n, sa = kernel_n + 1, sa + (row < ranges.n_taxels)
                rates.append(1000 * len(spikes.train(row)) / len(readings))
                forces.add(trial.force_g)
    return Differences(n, kernel_n, orders, sa, rates, forces)


def accuracies(
    representations: RepresentationSet, samples: Sequence[NDArray[np.uint16]], folder: Path
) -> tuple[list[TaskResult], list[TaskResult]]:
    """Return the results of the representations without C by the kernel, and by printed order."""
    features = {key: [] for key in PLAIN}  # type: dict[str, list[NDArray[np.float64]]]
    for trial, readings in zip(representations.trials.trials, samples, strict=True):
        spikes = as_spikes(raster(printed, readings, representations.normalisation))
        for one in representations.present[:2]:
            layout = representations.layout(one)
            features[one.key].append(trial_features(spikes, trial.speed_mm_s, layout))
    files = {key: folder / f"printed-{key}.npy" for key in PLAIN}
    for key, path in files.items():
        np.save(path, np.array(features[key]))
    ours = {key: representations.files[key] for key in PLAIN}
    both = [
        run_tasks(replace(representations, files=paths), SweepSettings())[0]
        for paths in (ours, files)
    ]
    return both[0], both[1]


def sentences(paths: Sequence[str]) -> list[str]:
    """Return how many trains differ and how far accuracies move."""
    with TemporaryDirectory() as name:
        found = represent(join_sessions([Path(path) for path in paths]), DEFAULT, Path(name))
        with open_trials(found.trials.files) as reader:
            samples = [reader.read(trial) for trial in found.trials.trials]
        trains = compare(found.trials.trials, samples, found.normalisation)
        ours, theirs = accuracies(found, samples, Path(name))
    n, rates = trains.trains, trains.rates_hz or [0.0]
    forces = ", ".join(f"{force:g}" for force in sorted(trains.forces_g))
    said = (
        f"{trains.kernel:,} of {n:,} trains differ ({trains.kernel / n:.1%}), {trains.sa} of them "
        f"SA, at {min(rates):.0f}–{max(rates):.0f} Hz and {forces} g; the two textbook orders: "
        f"{trains.orders:,} ({trains.orders / n:.1%})"
    )
    draws, means = [], []
    for one, other in zip(ours, theirs, strict=True):
        for a, b in zip(one.curves, other.curves, strict=True):
            draws.append(float(np.abs(a.accuracy - b.accuracy).max()))
            means.append(float(np.abs(a.mean - b.mean).max()))
    moved = f"a draw moves by up to {100 * max(draws):.1f} points, a mean by {100 * max(means):.1f}"
    return [said, moved]


if __name__ == "__main__":
    print("\n".join(sentences(sys.argv[1:])))
