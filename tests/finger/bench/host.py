"""A small host for tests: passes time on a virtual finger and collects what reaches it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.finger.bench.virtual import FingerTruthArrays, VirtualFinger
from rigctl.finger.board_messages import Message
from rigctl.finger.decoder import FingerBlock, FingerDecoder
from rigctl.finger.values import VelocityProfile
from rigctl.values import Position

IDLE_US = 1_500_000
"""Longer than the hand needs back to the start."""


class FingerHost:
    """Opens cable and tracker of a finger; every call takes simulated time."""

    def __init__(self, finger: VirtualFinger) -> None:
        self.rig = finger
        self.pieces: list[tuple[bytes, float]] = []
        self.positions: list[Position] = []
        self.lost: list[str] = []
        self.open_cable()
        finger.tracker.open(self.positions.append, self.lost.append)

    def open_cable(self) -> None:
        """Open the board's cable, from now on with an empty collection."""
        self.pieces.clear()
        self.rig.finger.open(lambda data, at_s: self.pieces.append((data, at_s)), self.lost.append)

    def wait(self, microseconds: int) -> None:
        """Let simulated time pass, as the event loop does."""
        until = self.rig.time_us + microseconds
        while self.rig.time_us < until:
            step = min(self.rig.slice_us, until - self.rig.time_us)
            self.rig.advance(self.rig.time_us + step)

    def slide(self, texture: str, profile: VelocityProfile) -> FingerTruthArrays:
        """Make one slide and return the truth of its milliseconds on the plate."""
        self.rig.slide(texture, profile)
        while self.rig.sliding:
            self.wait(10_000)
        self.wait(IDLE_US)
        return on_plate(self.rig.truth.arrays())

    def until_along(self, along_mm: float) -> None:
        """Wait in a slide until the finger is on the plate beyond a place."""
        while True:
            truth = self.rig.truth.arrays()
            if truth.force_g[-1:].any() and truth.along_mm[-1] > along_mm:
                return
            assert self.rig.sliding
            self.wait(10_000)

    def decode(self) -> tuple[FingerBlock, list[Message]]:
        """Return everything that the board has sent."""
        return FingerDecoder().feed(b"".join(data for data, _ in self.pieces))


def on_plate(truth: FingerTruthArrays) -> FingerTruthArrays:
    """Return the rows of the last slide that are in contact, first to last."""
    rows = np.flatnonzero((truth.slide == truth.slide[-1]) & (truth.force_g > 0.0))
    part = slice(rows[0], rows[-1] + 1)
    first, *columns = truth
    return FingerTruthArrays(first + int(rows[0]), *(column[part] for column in columns))


def speeds_mm_s(truth: FingerTruthArrays) -> NDArray[np.float64]:
    """Return the speed in each half between the marks, mm/s, float64 (2,)."""
    at = [int(np.argmax(truth.along_mm >= place)) for place in (50.0, 150.0, 250.0)]
    speeds: NDArray[np.float64] = 100_000.0 / np.diff(at)
    return speeds
