"""A loss of tracking is told when it ends, and only if it was long enough to shift the frame."""

from __future__ import annotations

import pytest

from rigctl.finger.devices import TrackingLoss
from rigctl.values import Position


def losses(valid: list[tuple[float, bool]]) -> list[float]:
    loss = TrackingLoss()
    told = [loss.add(Position(at_s, 0.0, 0.0, 0.0, is_valid)) for at_s, is_valid in valid]
    return [lost_s for lost_s in told if lost_s is not None]


@pytest.mark.parametrize(
    ("valid", "told"),
    [
        ([(0.0, True), (0.1, False), (0.5, False), (0.7, True), (0.8, True)], [0.6]),
        ([(0.0, True), (0.1, False), (0.6, True)], []),
        ([(0.0, False), (5.0, True)], []),
        ([(0.0, True), (5.0, True)], []),
        ([(0.0, True), (1.0, False), (2.0, True), (3.0, False), (5.0, True)], [1.0, 2.0]),
        ([(0.0, True), (0.1, False), (0.4, True), (0.5, False), (0.9, True)], []),
    ],
    ids=["long", "short", "before the first", "silent", "twice", "two short ones"],
)
def test_a_long_loss_is_told_once_with_its_length(
    valid: list[tuple[float, bool]], told: list[float]
) -> None:
    assert losses(valid) == pytest.approx(told)
