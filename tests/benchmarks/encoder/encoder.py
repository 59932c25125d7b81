"""Benchmark the encoder against Brian2 and NumPy: 36 neurons × 10 s × 100 trials, strict float64.

Our encoder and batched NumPy convert integer readings to spike trains. A second NumPy figure times
the neurons alone, from currents to counts. Brian2 also starts from currents.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import Encoder, encode_trials
from rigctl.encoder.force_gain import divided
from rigctl.encoder.kernel import simd
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, PRESETS, EncoderParameters
from rigctl.values import Spikes
from tests.benchmarks.encoder import _peers
from tests.benchmarks.encoder.numpy_encoder import currents, numpy_spikes, numpy_trains

N_TRIALS, N_SAMPLES, N_TAXELS = 100, 10_000, 18
TAXELS = range(N_TAXELS)
NEURON_MS = N_TRIALS * N_SAMPLES * 2 * N_TAXELS
LIVE_BATCH, LIVE_BATCHES = 10, 200
"""As the engine passes samples on in real time."""
COMPARED_TRAINS, PER_TRIAL_SAMPLE, BRIAN2_RUNS = 500, 2, 3
RANGES = Normalisation.full_scale(N_TAXELS)
SCENE = "36 neurons x 10 s x 100 trials, 1 ms samples, 4 substeps, float64"

# Arithmetic of a neuron in a sample: three fused multiply-adds, an addition and a comparison in
# each of four substeps; one operation for the current; five for the filter of an RA neuron, so 5/2
# on average.
OPERATIONS = 4 * 5 + 1 + 5 / 2

Trials = list[NDArray[np.uint16]]


def measure() -> Iterator[dict[str, Any]]:
    """Yield all figures of the encoder."""
    trials = scene()
    ours = per_neuron_ms(best_of(5, lambda: encode_trials(trials, RANGES)))
    yield _arithmetic_limit(ours)
    yield _live_gain(trials[0])
    yield from _against_numpy(trials)
    if not _peers.available():
        for name in ("vs_brian2_cpp", "vs_brian2_cython", "differing_trains"):
            yield _peers.row(f"encoder.{name}", ours, "ns/neuron-ms", "Brian2", None, _peers.ABSENT)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield from _against_brian2(trials, Path(folder))


def per_neuron_ms(seconds: float) -> float:
    """Convert the time for the scene to ns per neuron and simulated ms."""
    return 1e9 * seconds / NEURON_MS


def encode_on_cores(n: int, trials: Trials, parameters: EncoderParameters) -> None:
    """Encode all trials in ``n`` threads, which run in parallel as the kernels release the GIL."""
    with ThreadPoolExecutor(n) as pool:
        shares = [trials[i::n] for i in range(n)]
        list(pool.map(lambda share: encode_trials(share, RANGES, parameters), shares))


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@numba.njit(nogil=True)
def _multiply_add_loop(times: Any, out: Any) -> None:
    """Compute fused multiply-adds on twelve independent vectors.

    Twelve hide the latency of the instruction and fit in sixteen registers.
    """
    a, b, c = simd.broadcast(out[0], 4), simd.broadcast(out[0], 4), simd.broadcast(out[0], 4)
    keep, new = simd.broadcast(0.999, 4), simd.broadcast(0.001, 4)
    for _ in range(times):
        a, b, c = simd.fma(a, keep, new), simd.fma(b, keep, new), simd.fma(c, keep, new)
    simd.store(out, 0, simd.add(simd.add(a, b), c))


def _arithmetic_limit(ours: float) -> dict[str, Any]:
    """Return the time of the arithmetic alone at the processor's highest rate."""
    times, lanes = 2_000_000, 12 * simd.VECTOR_WIDTH
    out = np.ones(lanes)
    peak = 1e9 * best_of(5, lambda: _multiply_add_loop(times, out)) / (times * lanes)
    note = (
        f"{OPERATIONS} multiply-adds, additions and comparisons a neuron-ms at the "
        f"{1 / peak:.1f} per ns that a loop of multiply-adds reached in this run; without "
        "selecting, counting, reading, and sorting the spikes; one core"
    )
    return _peers.row(
        "encoder.multiply_add_limit",
        ours,
        "ns/neuron-ms",
        "arithmetic alone",
        OPERATIONS * peak,
        note,
    )


def scene(seed: int = 0) -> Trials:
    """Return trials, uint16 (10,000, 18): waves of 5–30 Hz on a constant pressure, with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(N_SAMPLES)[:, None] / 1000
    trials = []
    for _ in range(N_TRIALS):
        wave = np.sin(2 * np.pi * rng.uniform(5, 30, N_TAXELS) * t + rng.uniform(0, 6, N_TAXELS))
        x = rng.uniform(0.3, 0.7, N_TAXELS) + rng.uniform(0.02, 0.2, N_TAXELS) * wave
        x += rng.normal(0, 0.002, x.shape)
        trials.append(np.round(1023 * np.clip(x, 0, 1)).astype(np.uint16))
    return trials


def best_of(times: int, action: Callable[[], Any]) -> float:
    """Return the shortest wall time of an action, s, after one untimed call."""
    action()
    shortest = float("inf")
    for _ in range(times):
        start = time.perf_counter()
        action()
        shortest = min(shortest, time.perf_counter() - start)
    return shortest


def _against_numpy(trials: Trials) -> Iterator[dict[str, Any]]:
    def encode() -> list[Spikes]:
        return encode_trials(trials, RANGES)

    unit, readings = "ns/neuron-ms", np.hstack(trials)
    both = [per_neuron_ms(s) for s in median_times_s(encode, lambda: numpy_trains(readings))]
    unlike = _count_unlike(encode(), *numpy_trains(readings))
    note = (
        f"{SCENE}; readings to trains on both sides, {unlike} trains differ; median of nine runs "
        "against median of three, in turns; one thread each"
    )
    yield _peers.row("encoder.vs_numpy_batched", both[0], unit, "NumPy, all trials", both[1], note)
    drives = np.hstack([currents(samples, DEFAULT) for samples in trials])
    both = [per_neuron_ms(s) for s in median_times_s(encode, lambda: numpy_spikes(drives))]
    note = "the same, but NumPy starts from currents and returns counts, not trains"
    name = "encoder.vs_numpy_neurons_alone"
    yield _peers.row(name, both[0], unit, "NumPy, all trials, neurons alone", both[1], note)
    start = time.perf_counter()
    for samples in trials[:PER_TRIAL_SAMPLE]:
        numpy_spikes(currents(samples, DEFAULT))
    alone = per_neuron_ms(time.perf_counter() - start) * N_TRIALS / PER_TRIAL_SAMPLE
    note = f"{SCENE}; one thread each; the peer returns counts of {PER_TRIAL_SAMPLE} trials"
    name, peer = "encoder.vs_numpy_per_trial", "NumPy, trial by trial"
    yield _peers.row(name, both[0], unit, peer, alone, note)


def _live_gain(samples: NDArray[np.uint16]) -> dict[str, Any]:
    """Return what a live sample takes with a gain for the force, beside the encoder without."""
    batches = np.split(samples[: LIVE_BATCHES * LIVE_BATCH], LIVE_BATCHES)
    encoders = Encoder(RANGES, gain_of=divided), Encoder(RANGES)
    spent: tuple[list[float], list[float]] = ([], [])
    for _ in range(20):  # in turns, and the shortest: a batch is short beside the load of others
        for encoder, times in zip(encoders, spent, strict=True):
            start = time.thread_time()
            for batch in batches:
                encoder.encode(batch)
            times.append(1e6 * (time.thread_time() - start) / (LIVE_BATCHES * LIVE_BATCH))
    note = f"batches of {LIVE_BATCH} samples of {N_TAXELS} taxels; a gain may add 2 µs"
    with_gain, without = map(min, spent)
    return _peers.row("encoder.live_gain", with_gain, "µs/sample", "without a gain", without, note)


def median_times_s(ours: Callable[[], Any], theirs: Callable[[], Any]) -> tuple[float, float]:
    """Return the median wall time of each, s; they take turns, so that load affects both."""
    ours()
    spent: tuple[list[float], list[float]] = ([], [])
    for side in (0, 0, 1, 0) * 3:
        start = time.perf_counter()
        (theirs if side else ours)()
        spent[side].append(time.perf_counter() - start)
    return statistics.median(spent[0]), statistics.median(spent[1])


def _count_unlike(ours: list[Spikes], starts: NDArray[np.int64], samples: NDArray[np.int32]) -> int:
    """Return the number of trains that differ; NumPy's are SA of all trials' taxels, then RA."""
    trains = [spikes.train(c * N_TAXELS + k) for c in range(2) for spikes in ours for k in TAXELS]
    theirs = np.split(samples, starts[1:-1])
    return sum(not np.array_equal(*both) for both in zip(trains, theirs, strict=True))


def _against_brian2(trials: Trials, folder: Path) -> Iterator[dict[str, Any]]:
    explicit, unit = PRESETS["explicit"], "ns/neuron-ms"
    np.save(folder / "all.npy", np.hstack([currents(samples, explicit) for samples in trials]))
    variants = [("cpp", 1, ""), ("cython", 1, "")]
    if cores() > 1:
        variants.append(("cpp", cores(), "_all_cores"))
    for target, threads, suffix in variants:
        ours, theirs = [], []
        for _ in range(BRIAN2_RUNS):
            ours.append(best_of(3, partial(encode_on_cores, threads, trials, explicit)))
            answer = run_brian2(target, folder, "all", strict=False, threads=threads)
            theirs.append(answer["seconds"])
        peer = f"Brian2 {answer['brian2']} {target}"
        note = (
            f"{SCENE}; {threads} threads each; preset explicit; trains on both sides; Brian2 with "
            f"its default flags, without compilation; the median of {BRIAN2_RUNS} runs in turns"
        )
        both = [per_neuron_ms(statistics.median(times)) for times in (ours, theirs)]
        yield _peers.row(f"encoder.vs_brian2_{target}{suffix}", both[0], unit, peer, both[1], note)
    yield _differing_trains(trials, folder)


def _differing_trains(trials: Trials, folder: Path) -> dict[str, Any]:
    """Count the trains of the explicit preset that differ from Brian2's in any sample."""
    explicit = PRESETS["explicit"]
    some = trials[: -(-COMPARED_TRAINS // (2 * N_TAXELS))]
    drive = np.hstack([currents(samples, explicit) for samples in some])
    np.save(folder / "some.npy", drive[:, :COMPARED_TRAINS])
    answer = run_brian2("cpp", folder, "some", strict=True)
    theirs = np.load(folder / "some.npz")
    ours = [s.train(row) for s in encode_trials(some, RANGES, explicit) for row in range(36)]
    differing = sum(
        not np.array_equal(train, np.sort(theirs["sample"][theirs["neuron"] == index]))
        for index, train in enumerate(ours[:COMPARED_TRAINS])
    )
    peer = f"Brian2 {answer['brian2']} cpp, fast-math off"
    note = f"of {COMPARED_TRAINS} SA and RA trains of 10 s, {answer['spikes']} spikes in all"
    return _peers.row("encoder.differing_trains", differing, "trains", peer, 0, note)


def run_brian2(
    target: str, folder: Path, name: str, *, strict: bool, threads: int = 1
) -> dict[str, Any]:
    """Run Brian2 on the currents ``name``.npy in a folder; it writes spikes to ``name``.npz."""
    source, destination = str(folder / f"{name}.npy"), str(folder / f"{name}.npz")
    arguments = (target, source, destination, str(int(strict)), str(threads))
    return _peers.run_script("_brian2_scene.py", *arguments, threads=threads)
