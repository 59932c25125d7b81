"""The clock error of a board from replies with jitter."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.boards.clock_fit import ClockFit

RATE_HZ = 25


def readings(ppm: float, seconds: float, jitter: np.ndarray) -> ClockFit:
    fit = ClockFit()
    for n in range(int(seconds * RATE_HZ)):
        true_s = 1000.0 + n / RATE_HZ
        fit.add(true_s * (1 + ppm * 1e-6), true_s + float(jitter[n]))
    return fit


@pytest.mark.parametrize("ppm", [-5000.0, -900.0, 0.0, 1200.0, 5000.0])
def test_ten_seconds_of_jittery_replies_are_enough(ppm: float) -> None:
    random = np.random.default_rng(1)
    late = random.exponential(0.002, 1000)
    late[::17] += 0.03  # now and then the machine is busy
    estimate = readings(ppm, 10, late).estimate
    assert estimate is not None
    assert abs(estimate.ppm - ppm) < 200
    assert estimate.error_ppm < 100


def test_the_stated_error_covers_the_real_one_mostly() -> None:
    misses = 0
    for seed in range(40):
        jitter = np.random.default_rng(seed).uniform(0, 0.004, 1000)
        estimate = readings(1200, 8, jitter).estimate
        assert estimate is not None
        misses += abs(estimate.ppm - 1200) > 3 * estimate.error_ppm
    assert misses <= 2


def test_few_readings_are_no_estimate() -> None:
    assert readings(0, 0.4, np.zeros(10)).estimate is None


def test_a_reset_drops_all_readings() -> None:
    fit = readings(1200, 10, np.zeros(1000))
    fit.reset()
    assert fit.estimate is None


def test_readings_at_one_instant_are_no_estimate() -> None:
    fit = ClockFit()
    for _ in range(50):
        fit.add(1.0, 1.0)
    assert fit.estimate is None
