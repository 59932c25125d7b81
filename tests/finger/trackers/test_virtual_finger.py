"""The velocity of a virtual operator's slides, from a noisy tracker, beside the truth."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.bench.clock import SimulatedTimeLoop
from rigctl.finger.bench.virtual import open_virtual_finger
from rigctl.finger.driver import Finger
from rigctl.finger.trackers.plate_frame import fit_plate_frame
from rigctl.finger.trackers.velocity import EstimateSource, VelocityEstimator
from rigctl.finger.values import VelocityProfile


@pytest.mark.parametrize("profile", [VelocityProfile.SLOW, VelocityProfile.FAST])
def test_estimates_follow_the_finger(profile: VelocityProfile) -> None:
    world = open_virtual_finger(seed=3)
    loop = SimulatedTimeLoop(world, None)
    finger = Finger(world.finger, loop)
    estimator = VelocityEstimator(fit_plate_frame(world.touch_corners()))

    async def slide() -> None:
        await finger.connect()
        world.tracker.open(estimator.add, lambda reason: pytest.fail(reason))
        world.slide("B", profile)
        while world.sliding:
            await asyncio.sleep(0.1)
        await asyncio.sleep(0.3)

    try:
        loop.run_until_complete(slide())
        truth = world.truth.take()
        along_mm, on_plate = truth.along_mm.astype(float), truth.force_g > 100
        begin, end = np.flatnonzero(on_plate)[[0, -1]]
        errors, sources = [], []
        for first in range(begin, end - 100, 100):
            at_s = (truth.first_ms + first + 1) / 1000
            estimate = estimator.mean_velocity(at_s, at_s + 0.1)
            assert estimate is not None
            errors.append(estimate.mm_s - (along_mm[first + 100] - along_mm[first]) / 0.1)
            sources.append(estimate.source)
        assert EstimateSource.HELD not in sources
        assert np.std(errors) < 6 and np.abs(errors).max() < 15
        assert finger.counters.lost == finger.counters.damaged_frames == 0
    finally:
        finger.close()
        world.close()
        loop.close()
