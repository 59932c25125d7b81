"""Benchmark the moving finger on the host: cost of a batch, latencies, ten minutes without growth.

``make bench`` fails where a figure is above its limit.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rigctl.encoder.encoder import Encoder
from rigctl.finger.analysis.classifier import FingerClassifier
from rigctl.finger.analysis.scans import RecordedScans, read_scans
from rigctl.finger.model_file import load_finger_model
from rigctl.finger.models import calibrate_models, train_models
from rigctl.finger.scaled_time import first_windows, scale_windows
from rigctl.finger.values import Stage
from tests.finger.harness import (
    FingerHarness,
    open_finger_harness,
    open_finger_session,
    until_ended,
)

PROTOCOL = """
name = "benchmark"
textures = ["A", "B", "D", "L", "N"]
profiles = ["slow", "medium", "fast", "slow-to-fast", "fast-to-slow"]

[stages]
normalise = 1
train = 2
calibrate = 1
run = 1
"""
BATCHES = 2000
BATCH_SAMPLES = 100
MADE_UTC = "2026-01-02T03:04:05+00:00"
LINK = "virtual finger: 0.5 ms on the cable each way, answers at once, samples every 10 ms"


def measure() -> Iterator[dict[str, Any]]:
    """Yield the figures of the host's side."""
    with tempfile.TemporaryDirectory() as folder:
        recorded, model = _experiment(Path(folder))
        yield from _batch_costs(recorded, FingerClassifier(load_finger_model(model)))
        yield from _latencies(Path(folder) / "run", model)
        yield from _ten_minutes(Path(folder) / "long")


def _experiment(folder: Path) -> tuple[RecordedScans, Path]:
    """Record and train a small experiment; return its training scans and a calibrated model."""
    model = calibrated_model(folder)
    return read_scans(folder / "train" / "session"), model


def calibrated_model(folder: Path) -> Path:
    """Record and train a small experiment; return its calibrated model."""
    with open_finger_harness(folder / "train") as harness:
        harness.record(harness.request("normalise", "train", protocol=PROTOCOL))
        training = harness.session
    train_models(training, 25, MADE_UTC)
    with open_finger_harness(folder / "calibrate", session=1) as harness:
        model = training / "model-speed-scaled.h5"
        harness.record(harness.request("calibrate", protocol=PROTOCOL, model=model))
        calibrate_models(training, harness.session)
        return harness.session / model.name


def _batch_costs(recorded: RecordedScans, classifier: FingerClassifier) -> Iterator[dict[str, Any]]:
    """Time encoding, features and prediction of a batch, and the same with libraries alone."""
    one = recorded.recordings[0]
    encoder = Encoder(recorded.encoding.normalisation)
    readings = np.ascontiguousarray(one.readings[: 10 * BATCH_SAMPLES])
    velocities = one.velocities_um_per_s[:10]
    batch = readings[:BATCH_SAMPLES]
    encoder.encode(readings)

    def ours() -> None:
        spikes = encoder.encode(batch)[:, :9]
        windows = scale_windows(np.ascontiguousarray(spikes), velocities[:1])
        rates = first_windows(windows, 20)
        classifier.answer(rates[:10])

    peer = _library_batch(recorded)
    costs, peers = _timed(ours), _timed(peer)
    yield figure(
        "realtime.batch_ms_p99",
        float(np.percentile(costs, 99)),
        "ms",
        1.0,
        "processor time of encoding, features and prediction of 100 ms on the host; "
        f"{BATCHES} batches",
        "NumPy neurons of all taxels at once and a scikit-learn pipeline's predict_proba, p99",
        float(np.percentile(peers, 99)),
    )


def _library_batch(recorded: RecordedScans) -> Callable[[], None]:
    """Return the same work with NumPy and scikit-learn."""
    from sklearn.decomposition import PCA
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.pipeline import make_pipeline

    scans = recorded.scans.of_stage(Stage.TRAIN)
    features = scans.windows.reshape(len(scans), -1)
    pipeline = make_pipeline(PCA(25, svd_solver="full"), LinearDiscriminantAnalysis())
    pipeline.fit(features, scans.texture)
    readings = recorded.recordings[0].readings[:BATCH_SAMPLES].astype(np.float64)

    def batch() -> None:
        _numpy_neurons(readings / 1023.0)
        pipeline.predict_proba(features[:1])

    return batch


def _numpy_neurons(readings: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return spike counts of Izhikevich neurons, all taxels at once, four substeps a sample."""
    v, u = np.full(readings.shape[1], -70.0), np.full(readings.shape[1], -14.0)
    counts = np.zeros(readings.shape[1], np.int64)
    for row in readings:
        for _ in range(4):
            v = v + 0.25 * (0.04 * v * v + 5.0 * v + 140.0 - u + 100.0 * row)
            u = u + 0.25 * 0.02 * (0.2 * v - u)
            fired = v >= 30.0
            counts += fired
            v, u = np.where(fired, -65.0, v), np.where(fired, u + 6.0, u)
    return counts


def _timed(work: Callable[[], None]) -> NDArray[np.float64]:
    """Return the milliseconds of processor time of each of many calls.

    Wall time would include what other programs of the machine take.
    """
    for _ in range(20):
        work()
    costs = np.empty(BATCHES)
    with threadpool_limits(1):
        for i in range(BATCHES):
            began_ns = time.thread_time_ns()
            work()
            costs[i] = (time.thread_time_ns() - began_ns) / 1e6
    return costs


def _latencies(folder: Path, model: Path) -> Iterator[dict[str, Any]]:
    """Record a run and read the latencies that the session has."""
    with open_finger_harness(folder, session=1) as harness:
        began_s = time.perf_counter()
        harness.record(harness.request("run", protocol=PROTOCOL, model=model))
        wall_s, world_s = time.perf_counter() - began_s, harness.rig.loop.time()
        with open_finger_session(harness.session) as session:
            rows = session.latencies
            features = rows["ms"][rows["kind"] == "features"]
    note = (
        f"loop time from a velocity's sending to its windows at the host, {len(features)} batches"
    )
    yield figure("realtime.features_ms_max", float(features.max()), "ms", 5.0, f"{note}; {LINK}")
    note = "engine, virtual finger, firmware, recorder and classifier in one process, one core"
    yield figure("realtime.world_factor", world_s / wall_s, "× real time", None, note)


def _ten_minutes(folder: Path) -> Iterator[dict[str, Any]]:
    """Run ten minutes of world time; compare memory and cost of its second and last minute."""
    costs, sizes = [], []

    async def watch(harness: FingerHarness) -> None:
        for minute in range(1, 11):
            began_s = time.perf_counter()
            await harness.until(partial(_has_reached, harness, 60.0 * minute), 1e9)
            costs.append(time.perf_counter() - began_s)
            harness.rig.simulation.truth.take()  # the simulation's log is no part of the host
            harness.events.clear()
            sizes.append(_resident_mb())
        assert harness.engine.run is not None
        harness.engine.run.control.abort("the ten minutes are over")
        await until_ended(harness)

    protocol = PROTOCOL.replace("normalise = 1", "normalise = 20")
    with open_finger_harness(folder) as harness:
        harness.run(watch, harness.request("normalise", protocol=protocol))
    growth = sizes[-1] - sizes[1]
    yield figure(
        "realtime.memory_growth_mb",
        growth,
        "MB",
        8.0,
        f"resident memory after minute 10 less that after minute 2, {sizes[-1]:.0f} MB in all",
    )
    yield figure(
        "realtime.last_minute_cost",
        costs[-1] / costs[1],
        "ratio",
        1.5,
        f"processor time of minute 10 over minute 2 ({costs[1]:.2f} s)",
    )


def _has_reached(harness: FingerHarness, at_s: float) -> bool:
    """Return whether loop time has come so far."""
    return harness.rig.loop.time() >= at_s


def _resident_mb() -> float:
    """Return the resident memory of this process, without what the allocator keeps unused."""
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def figure(
    name: str,
    value: float,
    unit: str,
    limit: float | None,
    note: str,
    peer: str | None = None,
    peer_value: float | None = None,
) -> dict[str, Any]:
    """Return one figure; the benchmarks fail above its ``limit``."""
    return {
        "name": name,
        "value": round(value, 3),
        "unit": unit,
        "peer": peer,
        "peer_value": round(peer_value, 3) if peer_value is not None else None,
        "ratio": round(peer_value / value, 2) if peer_value is not None else None,
        "limit": limit,
        "note": note,
    }
