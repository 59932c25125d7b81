"""A rig that runs for weeks needs no more memory than one that runs for minutes.

What is counted are the bytes that Python and NumPy hold, over a span of the rig's own time: neither
the machine nor its load changes them.
"""

from __future__ import annotations

import asyncio
import gc
import tracemalloc
from collections.abc import Callable, Iterator

import pytest

from rigctl.bench import ground_truth
from rigctl.engine.rig import Rig
from rigctl.rig import open_rig
from rigctl.session import data_quality
from tests.engine.engine_harness import EngineHarness, until_ended

LONG = """
name = "long"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 500
"""
WARM_UP_S = 120.0
SPAN_S = 240.0
MOST_BYTES_PER_HOUR = 6_000_000
"""0.4 MB in the span. A truth that nobody takes is 32 MB."""
LOOKS = 6


@pytest.fixture
def held() -> Iterator[Callable[[], int]]:
    """Return a function that counts the bytes that are held now."""

    def count() -> int:
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    yield count
    tracemalloc.stop()


async def least_held(harness: EngineHarness, held: Callable[[], int]) -> int:
    """Return the fewest bytes held within some seconds: what is on its way varies by 0.2 MB."""
    counts = []
    for _ in range(LOOKS):
        await harness.wait(1.7)
        harness.events.clear()  # the test's own list
        counts.append(held())
    return min(counts)


def per_hour(before: int, after: int) -> float:
    """Return the growth over a span as bytes per hour of the rig's time."""
    return (after - before) * 3600 / SPAN_S


def test_a_run_holds_no_more_memory_the_longer_it_lasts(
    harness: EngineHarness, held: Callable[[], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.wait(WARM_UP_S)
        before = await least_held(harness, held)
        await harness.wait(SPAN_S)
        growths.append(per_hour(before, await least_held(harness, held)))
        assert harness.engine.run is not None
        harness.engine.run.control.abort("measured")
        await until_ended(harness)

    growths: list[float] = []
    # The history that trials are judged by is bounded: full within the warm-up.
    monkeypatch.setattr(data_quality, "MAX_RESIDUALS", 35)
    harness.run(scenario, harness.request(LONG))
    assert growths[0] < MOST_BYTES_PER_HOUR


async def poll(rig: Rig, seconds: float) -> None:
    """Poll the drum, as a program without an engine does, which takes no truth."""
    end_s = rig.loop.time() + seconds
    while rig.loop.time() < end_s:
        await rig.drum.poll()
        await asyncio.sleep(0.05)


def test_a_virtual_rig_without_an_engine_holds_no_more_memory(
    held: Callable[[], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> float:
        await rig.drum.connect()
        await rig.taxels.connect()
        await poll(rig, WARM_UP_S)
        before = held()
        await poll(rig, SPAN_S)
        return per_hour(before, held())

    monkeypatch.setattr(ground_truth, "KEPT_MS", int(WARM_UP_S * 500))
    rig = open_rig("virtual", paced=False)
    try:
        assert rig.loop.run_until_complete(scenario()) < MOST_BYTES_PER_HOUR
        truth = rig.truth.arrays()
        assert truth.end_ms == pytest.approx(rig.loop.time() * 1000, abs=2)
        assert 0 <= len(truth.sync) - WARM_UP_S * 500 <= 1000
    finally:
        rig.close()
