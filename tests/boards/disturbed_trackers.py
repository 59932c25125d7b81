"""The trackers' lines and datagrams, disturbed on their way, against the truth."""

from __future__ import annotations

from functools import reduce
from operator import xor

import numpy as np

from rigctl.boards.links import OnBytes, OnLost
from rigctl.finger.trackers.imu import ImuIntegrator, ImuTracker
from rigctl.finger.trackers.streaming import (
    LOOPBACK,
    SerialTracker,
    StreamingTracker,
    UdpTracker,
)
from rigctl.values import Position
from tests.boards.disturbance import Disturbance, cut
from tests.boards.disturbed_boards import Judgement
from tests.boards.memory_link import JumpingLoop, run

PERIOD_MS = 10.0


class _Cable:
    """A cable whose bytes the test hands over itself."""

    name = "cable"
    is_open = True

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        self.say = on_bytes

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class _Readings(ImuIntegrator):
    """In place of the integrator: the first number of a reading says which one it is."""

    def add(
        self,
        at_s: float,
        acceleration_m_s2: tuple[float, float, float],
        turn_rad_s: tuple[float, float, float],
    ) -> Position:
        number, *others = acceleration_m_s2
        right = (*others, *turn_rad_s) == (0.5, 9.8, 0.25, -0.5, number)
        return Position(at_s, number if right else -1.0, 1.0, 2.0, True)


def with_checksum(text: str) -> bytes:
    """Return a line with its checksum."""
    return f"{text}*{reduce(xor, text.encode(), 0):02X}\n".encode()


def _line(kind: str, i: int, checks: bool) -> bytes:
    time_ms = PERIOD_MS * (i + 1)
    text = {
        "lines": f"{time_ms},{i}.125,1.0,2.0,1",
        "datagrams": f"{i},{time_ms},{i}.125,1.0,2.0,1",
        "IMU": f"{time_ms},{i}.125,0.5,9.8,0.25,-0.5,{i}.125",
    }[kind]
    return with_checksum(text) if checks else f"{text}\n".encode()


def run_tracker(kind: str, how: Disturbance, n_bytes: int, seed: int) -> Judgement:
    """Deliver about ``n_bytes`` of a tracker's messages and judge the positions.

    Lines have checksums where bits are flipped. They have no number: what the tracker counts is
    what it refused, and a dropped line is only a longer step in time.
    """
    rng = np.random.default_rng(seed)
    lines = [_line(kind, i, checks=how.flips > 0) for i in range(n_bytes // 42)]
    arrived = [lines[0], *how.apply(lines[1:-1], rng), lines[-1]]
    judgement = Judgement(f"tracker {kind}, {how.name}", sum(map(len, arrived)), len(arrived))
    places: list[float] = []

    async def main(loop: JumpingLoop) -> None:
        tracker, cable = _tracker(kind, loop)
        tracker.open(lambda position: places.append(position.x_mm - 0.125), _fail)
        if isinstance(tracker, ImuTracker):
            tracker.integrator = _Readings()
        at_s = 0.0
        for piece in arrived if kind == "datagrams" else cut(b"x\n" + b"".join(arrived), rng, 200):
            at_s += PERIOD_MS / 1000.0 * len(piece) / 42
            if isinstance(tracker, UdpTracker):
                tracker.take(piece, LOOPBACK, at_s)
            else:
                cable.say(piece, at_s)
        judgement.reboots_told = tracker.counters.clock_restarts
        judgement.counted = tracker.counters.lost
        tracker.close()

    run(main)
    numbers = np.array(places)
    judgement.samples = judgement.intact = len(numbers)
    judgement.wrong_samples = int(np.sum((numbers % 1 != 0) | (numbers < 0)))
    judgement.wrong_counters = int(np.sum(np.diff(numbers) <= 0))
    if kind == "datagrams":
        judgement.lost = int(numbers[-1] - numbers[0]) + 1 - len(numbers)
    return judgement


def _tracker(kind: str, loop: JumpingLoop) -> tuple[StreamingTracker, _Cable]:
    cable = _Cable()
    if kind == "datagrams":
        return UdpTracker(0, loop), cable
    return (ImuTracker if kind == "IMU" else SerialTracker)(cable, loop), cable


def _fail(reason: str) -> None:
    raise AssertionError(reason)
