"""Distances of spike trains against elephant's values and against the plain recursions."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.spike_distances import TrainTable, van_rossum, victor_purpura

TRAINS: list[list[float]] = [
    [],
    [100.0],
    [100, 112.5, 300],
    [108, 310, 311, 900],
    [50, 100, 100.5, 299, 905, 906.25, 1500],
]
# elephant 1.2.1, victor_purpura_distance(trains, 100 Hz), van_rossum_distance(trains, 10 ms).
ELEPHANT_VICTOR_PURPURA = [
    [0, 1, 3, 4, 7],
    [1, 0, 2, 3.8, 6],
    [3, 2, 0, 4.45, 5.3],
    [4, 3.8, 4.45, 0, 7.35],
    [7, 6, 5.3, 7.35, 0],
]
ELEPHANT_VAN_ROSSUM = [
    [0, 1, 1.890240622839, 2.410326708664, 3.270129542455],
    [1, 0, 1.41421356746, 2.431258297956, 2.788872976111],
    [1.890240622839, 1.41421356746, 0, 2.4098276186, 2.713279989761],
    [2.410326708664, 2.431258297956, 2.4098276186, 0, 3.332005573219],
    [3.270129542455, 2.788872976111, 2.713279989761, 3.332005573219, 0],
]


def table(trains: list[list[float]]) -> TrainTable:
    """Return trials of one train each."""
    return TrainTable.of([[np.array(train)] for train in trains])


def test_the_distances_are_elephants() -> None:
    found = victor_purpura(table(TRAINS), range(5), 0.1)
    np.testing.assert_allclose(found, ELEPHANT_VICTOR_PURPURA, atol=1e-12)
    found = van_rossum(table(TRAINS), range(5), 10.0)
    np.testing.assert_allclose(found, ELEPHANT_VAN_ROSSUM, atol=1e-9)


def plain_victor_purpura(a: list[float], b: list[float], cost: float) -> float:
    grid = np.add.outer(np.arange(len(a) + 1.0), np.arange(len(b) + 1.0))
    for i in range(1, len(a) + 1):
        for j in range(1, len(b) + 1):
            moved = grid[i - 1, j - 1] + cost * abs(a[i - 1] - b[j - 1])
            grid[i, j] = min(grid[i - 1, j] + 1, grid[i, j - 1] + 1, moved)
    return float(grid[-1, -1])


@pytest.mark.parametrize("cost", [0.003, 0.02, 0.1, 1.0, 50.0])
def test_leaving_out_far_pairs_changes_no_distance(cost: float) -> None:
    random = np.random.default_rng(int(1000 * cost))
    trains = [
        np.sort(random.choice(4000, random.integers(0, 60), replace=False) / 4).tolist()
        for _ in range(14)
    ]
    trains += [trains[0], [5.0, 5.0, 5.0, 400.0]]  # several spikes in a sample are kept
    found = victor_purpura(table(trains), range(3, 16), cost)
    expected = [[plain_victor_purpura(a, b, cost) for b in trains] for a in trains[3:]]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_trains_of_a_trial_add_up() -> None:
    pairs = zip(TRAINS, TRAINS[::-1], strict=True)
    both = TrainTable.of([[np.array(a), np.array(b)] for a, b in pairs])
    one, other = np.array(ELEPHANT_VICTOR_PURPURA), np.array(ELEPHANT_VICTOR_PURPURA)[::-1, ::-1]
    np.testing.assert_allclose(victor_purpura(both, range(5), 0.1), one + other, atol=1e-12)
    one, other = np.array(ELEPHANT_VAN_ROSSUM), np.array(ELEPHANT_VAN_ROSSUM)[::-1, ::-1]
    np.testing.assert_allclose(van_rossum(both, range(5), 10.0), np.hypot(one, other), atol=1e-9)
