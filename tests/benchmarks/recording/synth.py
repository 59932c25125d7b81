"""Benchmark ``rigctl synth`` against the virtual rig: speed, and difference of the data."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.session.ground_truth import trial_truths
from rigctl.session.session import Session
from rigctl.synth.dataset import DatasetRequest, generate, load_plan
from tests.engine.engine_harness import open_harness

SEED = 1
ROUNDS = 5
START_UTC = "2026-01-02T03:04:05+00:00"
TEXT = """
name = "bench"
textures = ["A", "D", "L"]
speeds_mm_s = [40, 80, 120]
forces_g = [250, 500, 1000]
repeats = 1
"""


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``synth.realtime_factor`` and the rig's, and the differences of their samples."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        protocol = folder / "bench.toml"
        protocol.write_text(TEXT)
        generation_time_s(protocol, folder / "warm")
        trial_s = sum(trial.duration_s for trial in load_plan(protocol, None, SEED).trials)
        made = [generation_time_s(protocol, folder / f"synth-{i}") for i in range(ROUNDS)]
        with open_harness(folder, SEED) as harness:
            began_s, began_core_s = time.perf_counter(), time.process_time()
            harness.record(TEXT)
            rig_s, rig_core_s = time.perf_counter() - began_s, time.process_time() - began_core_s
            whole = harness.session
        yield from _factors(trial_s, made, (rig_s, rig_core_s))
        yield from _distances(folder / "synth-0", whole)


def generation_time_s(protocol: Path, folder: Path) -> tuple[float, float]:
    """Return wall and processor seconds to generate a protocol's data set."""
    request = DatasetRequest(load_plan(protocol, None, SEED), SEED, folder, START_UTC)
    began_s, began_core_s = time.perf_counter(), time.process_time()
    generate(request, lambda progress: None, lambda: False)
    return time.perf_counter() - began_s, time.process_time() - began_core_s


def _factors(
    trial_s: float, made: list[tuple[float, float]], rig: tuple[float, float]
) -> Iterator[dict[str, Any]]:
    wall, core = (trial_s / min(times) for times in zip(*made, strict=True))
    slowest = trial_s / max(core_s for _, core_s in made)
    yield {
        "name": "synth.realtime_factor",
        "value": round(core, 1),
        "unit": "× trial time a processor second",
        "peer": "whole virtual rig, same protocol",
        "peer_value": round(trial_s / rig[1], 1),
        "ratio": round(core * rig[1] / trial_s, 1),
        "note": f"{trial_s:g} s of trials; best of {ROUNDS}, slowest {slowest:.0f} ×; by the wall "
        f"{wall:.0f} × and "
        f"{trial_s / rig[0]:.1f} ×; approach, lift and moves are in the time, not in the trials",
    }


def _distances(made: Path, recorded: Path) -> Iterator[dict[str, Any]]:
    """Yield the differences in mean reading, true force and true speed of the trials."""
    with Session.open(made) as synth, Session.open(recorded) as rig:
        pairs = list(zip(synth.committed(), rig.committed(), strict=True))
        means = [
            np.abs(synth.samples(int(a)).mean(axis=0) - rig.samples(int(b)).mean(axis=0))
            for a, b in pairs
        ]
        truths = list(zip(trial_truths(synth), trial_truths(rig), strict=True))
    force = [abs((1 + a.force_error) / (1 + b.force_error) - 1) for a, b in truths]
    speed = [abs((1 + a.speed_error) / (1 + b.speed_error) - 1) for a, b in truths]
    yield _row("synth.level_difference", float(np.max(means)), "counts", f"{np.mean(means):.3f}")
    yield _row("synth.force_difference", 1e6 * max(force), "ppm", f"{1e6 * np.mean(force):.0f}")
    yield _row("synth.speed_difference", 1e6 * max(speed), "ppm", f"{1e6 * np.mean(speed):.1f}")


def _row(name: str, worst: float, unit: str, mean: str) -> dict[str, Any]:
    return {
        "name": name,
        "value": round(worst, 3),
        "unit": unit,
        "peer": "whole virtual rig, same seed and protocol",
        "peer_value": None,
        "ratio": None,
        "note": f"largest over trials{' and taxels' if unit == 'counts' else ''} of the means over "
        f"a trial; mean {mean}",
    }
