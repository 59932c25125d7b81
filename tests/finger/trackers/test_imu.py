"""The drift of an integrated accelerometer, measured on a known movement from mark to mark."""

from __future__ import annotations

import asyncio

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rigctl.finger.trackers.imu import ImuIntegrator, ImuTracker
from rigctl.values import Position
from tests.boards.memory_link import JumpingLoop, MemoryLink

RATE_HZ = 200
REST_S, MOVE_S = 1.0, 2.0
Floats = NDArray[np.float64]


def movement(seconds: float = MOVE_S) -> tuple[Floats, Floats, Floats]:
    """Time in s, place in mm from 50 to 250 with least jerk, and acceleration in m/s²."""
    time_s = np.arange(0, seconds + 2 * REST_S, 1 / RATE_HZ)
    share = np.clip((time_s - REST_S) / seconds, 0, 1)
    place = 50 + 200 * (10 * share**3 - 15 * share**4 + 6 * share**5)
    acceleration = 0.2 / seconds**2 * (60 * share - 180 * share**2 + 120 * share**3)
    return time_s, place, acceleration


def readings(acceleration: Floats, seed: int) -> Floats:
    """What a tilted sensor with biases and noise measures while the hand wobbles, (n, 6)."""
    random, n = np.random.default_rng(seed), len(acceleration)
    mounted = Rotation.from_euler("xyz", [2, -3, 0], degrees=True)
    turning = np.clip((np.arange(n) / RATE_HZ - REST_S) / MOVE_S, 0, 1)
    wobble = np.deg2rad(3.0) * np.sin(2 * np.pi * turning) ** 2
    turn = np.gradient(wobble, 1 / RATE_HZ)
    force = np.column_stack([acceleration, np.zeros(n), np.full(n, 9.81)])
    force = mounted.inv().apply(force)
    force = Rotation.from_rotvec(np.outer(wobble, [0, 1, 0])).inv().apply(force)
    force += np.array([0.08, -0.05, 0.1]) + random.normal(0, 0.03, (n, 3))
    rates = np.outer(turn, [0, 1, 0]) + np.array([0.01, -0.02, 0.005])
    return np.column_stack([force, rates + random.normal(0, 0.002, (n, 3))])


def integrate(seed: int, seconds: float = MOVE_S) -> tuple[ImuIntegrator, Floats, Floats]:
    time_s, place, acceleration = movement(seconds)
    integrator = ImuIntegrator()
    positions = [
        integrator.add(float(at_s), (r[0], r[1], r[2]), (r[3], r[4], r[5]))
        for at_s, r in zip(time_s, readings(acceleration, seed), strict=True)
    ]
    x_mm = np.array([p.x_mm if p.valid else np.nan for p in positions])
    return integrator, x_mm, place


def test_the_drift_of_a_known_movement() -> None:
    """2 s from mark to mark: the zero-velocity update takes most of the drift away."""
    velocities, places, errors = [], [], []
    for seed in range(8):
        integrator, x_mm, place = integrate(seed)
        (drift,) = integrator.drifts
        velocities.append(drift.velocity_mm_s)
        places.append(drift.place_mm)
        moving = slice(round(REST_S * RATE_HZ), round((REST_S + MOVE_S) * RATE_HZ))
        errors.append(np.nanmax(np.abs(x_mm - place)[moving]))
        assert x_mm[-1] == 250.0
    assert np.abs(velocities).max() < 30.0
    assert np.abs(errors).max() < 40.0
    assert np.abs(places).max() < 15.0


def test_before_the_first_rest_and_after_a_gap_positions_are_invalid() -> None:
    integrator = ImuIntegrator()
    still = (0.0, 0.0, 9.81)
    valid = [integrator.add(n / RATE_HZ, still, (0.0, 0.0, 0.0)).valid for n in range(RATE_HZ)]
    assert not any(valid[:80]) and all(valid[110:])
    assert not integrator.add(2.0, still, (0.0, 0.0, 0.0)).valid
    assert integrator.drifts == []


def test_an_even_slide_is_no_rest_and_a_movement_without_end_is_invalid() -> None:
    integrator = ImuIntegrator()
    at_s, x_mm = 0.0, 0.0
    last = Position(0.0, 0.0, 0.0, 0.0, False)
    for seconds, push in [(1.0, 0.0), (0.1, 1.0), (5.0, 0.0), (6.0, 0.0)]:
        for _ in range(round(seconds * RATE_HZ)):
            at_s += 1 / RATE_HZ
            last = integrator.add(at_s, (push, 0.0, 9.81), (0.0, 0.0, 0.0))
        if at_s < 7:
            assert last.valid
            assert last.x_mm - 50.0 >= x_mm
            x_mm = last.x_mm - 50.0
    assert 300 < x_mm < 600
    assert integrator.drifts[-1].seconds > 10.0


async def test_an_imu_is_a_tracker(loop: JumpingLoop) -> None:
    link, positions, lost = MemoryLink(loop, "/dev/imu"), [], []
    tracker = ImuTracker(link, loop)
    tracker.open(positions.append, lost.append)
    time_s, _, acceleration = movement()
    for at_s, values in zip(time_s, readings(acceleration, 3), strict=True):
        line = ",".join(f"{value:.5f}" for value in (at_s * 1000, *values))
        link.say(line.encode() + b"\n", float(at_s) + 0.001)
    link.say(b"junk\n", 3.5)
    await asyncio.sleep(4.2)
    assert positions[-1].valid and positions[-1].x_mm == 250.0
    assert len(tracker.integrator.drifts) == 1
    assert (tracker.counters.malformed, tracker.counters.out_of_order) == (1, 0)
    assert lost == []
    link.unplug()
    assert lost == ["/dev/imu: the port vanished"]
