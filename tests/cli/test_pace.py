"""The pace of a long command, from which the time left follows."""

from __future__ import annotations

import pytest

from rigctl.cli.progress import PACE_S, Pace


def test_a_slow_begin_does_not_count() -> None:
    pace = Pace()
    assert pace.add(8.0, 1.0) == 0.0, "eight seconds until the first trial say nothing"
    assert pace.add(8.5, 101.0) == pytest.approx(200.0)


def test_the_pace_is_that_of_the_last_half_minute() -> None:
    pace = Pace()
    for second in range(100):
        pace.add(float(second), 10.0 * second)
    for second in range(100, 100 + round(PACE_S) + 1):
        found = pace.add(float(second), 990.0 + 2.0 * (second - 99))
    assert found == pytest.approx(2.0)


def test_nothing_done_is_no_pace() -> None:
    pace = Pace()
    assert [pace.add(1.0, 5.0), pace.add(1.0, 5.0), pace.add(2.0, 5.0)] == [0.0, 0.0, 0.0]
