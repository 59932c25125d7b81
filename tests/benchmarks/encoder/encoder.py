"""The encoder beside Brian2 and NumPy: 36 neurons × 10 s × 100 trials, strict float64.

Ours makes spike trains of integer readings. So does NumPy, batched; beside it stands what its
neurons alone take, from finished currents to counts. Brian2 is handed finished currents too.
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

from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.kernel import simd
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, PRESETS, EncoderParameters
from rigctl.values import Spikes
from tests.benchmarks.encoder import _peers
from tests.benchmarks.encoder.numpy_encoder import currents, numpy_spikes, numpy_trains

N_TRIALS, N_SAMPLES, N_TAXELS = 100, 10_000, 18
TAXELS = range(N_TAXELS)
NEURON_MS = N_TRIALS * N_SAMPLES * 2 * N_TAXELS
COMPARED_TRAINS, PER_TRIAL_SAMPLE, BRIAN2_RUNS = 500, 2, 3
RANGES = Normalisation.full_scale(N_TAXELS)
SCENE = "36 neurons x 10 s x 100 trials, 1 ms samples, 4 substeps, float64"

# Fused multiply-adds, additions and comparisons that a neuron needs in a sample: three, one and one
# in each of four substeps, one for the current, and half of the filter's five, as half are RA.
OPERATIONS = 4 * 5 + 1 + 5 / 2

Trials = list[NDArray[np.uint16]]


def measure() -> Iterator[dict[str, Any]]:
    """All figures of the encoder."""
    trials = scene()
    ours = per_neuron_ms(best_of(5, lambda: encode_trials(trials, RANGES)))
    yield _limit(ours)
    yield from _against_numpy(trials)
    if not _peers.available():
        for name in ("vs_brian2_cpp", "vs_brian2_cython", "differing_trains"):
            yield _peers.row(f"encoder.{name}", ours, "ns/neuron-ms", "Brian2", None, _peers.ABSENT)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield from _against_brian2(trials, Path(folder))


def per_neuron_ms(seconds: float) -> float:
    """Time for the whole scene in ns for each neuron and ms."""
    return 1e9 * seconds / NEURON_MS


def on_cores(n: int, trials: Trials, parameters: EncoderParameters) -> None:
    """Trains of all trials, each of some cores with a share; the kernels release the GIL."""
    with ThreadPoolExecutor(n) as pool:
        shares = [trials[i::n] for i in range(n)]
        list(pool.map(lambda share: encode_trials(share, RANGES, parameters), shares))


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@numba.njit(nogil=True)
def _fused(times: Any, out: Any) -> None:
    """Nothing but fused multiply-adds: twelve vectors that do not wait for each other.

    As many as hide the latency, and no more than have room in sixteen registers.
    """
    a, b, c = simd.broadcast(out[0], 4), simd.broadcast(out[0], 4), simd.broadcast(out[0], 4)
    keep, new = simd.broadcast(0.999, 4), simd.broadcast(0.001, 4)
    for _ in range(times):
        a, b, c = simd.fma(a, keep, new), simd.fma(b, keep, new), simd.fma(c, keep, new)
    simd.store(out, 0, simd.add(simd.add(a, b), c))


def _limit(ours: float) -> dict[str, Any]:
    """How long the arithmetic alone would take at the processor's highest rate."""
    times, lanes = 2_000_000, 12 * simd.VECTOR_WIDTH
    out = np.ones(lanes)
    peak = 1e9 * best_of(5, lambda: _fused(times, out)) / (times * lanes)
    note = (
        f"{OPERATIONS} multiply-adds, additions and comparisons a neuron-ms at the "
        f"{1 / peak:.1f} a ns that a loop of nothing else reached in this run; not in it: "
        "choosing, counting, reading, and putting the spikes in order; one core"
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
    """Trials uint16 (10,000, 18) of waves at 5–30 Hz on a steady pressure, with a little noise."""
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
    """Shortest wall time of an action, s, after one run to warm it."""
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
    both = [per_neuron_ms(s) for s in in_turns(encode, lambda: numpy_trains(readings))]
    unlike = _unlike(encode(), *numpy_trains(readings))
    note = (
        f"{SCENE}; readings to trains on both sides, {unlike} of the trains unlike; the middle of "
        "nine runs beside that of three, in turns; one thread each"
    )
    yield _peers.row("encoder.vs_numpy_batched", both[0], unit, "NumPy, all trials", both[1], note)
    drives = np.hstack([currents(samples, DEFAULT) for samples in trials])
    both = [per_neuron_ms(s) for s in in_turns(encode, lambda: numpy_spikes(drives))]
    note = "the same, but NumPy is handed finished currents and makes counts, not trains"
    name = "encoder.vs_numpy_neurons_alone"
    yield _peers.row(name, both[0], unit, "NumPy, all trials, neurons alone", both[1], note)
    start = time.perf_counter()
    for samples in trials[:PER_TRIAL_SAMPLE]:
        numpy_spikes(currents(samples, DEFAULT))
    alone = per_neuron_ms(time.perf_counter() - start) * N_TRIALS / PER_TRIAL_SAMPLE
    note = f"{SCENE}; one thread each; the peer makes counts of {PER_TRIAL_SAMPLE} of the trials"
    name, peer = "encoder.vs_numpy_per_trial", "NumPy, trial by trial"
    yield _peers.row(name, both[0], unit, peer, alone, note)


def in_turns(ours: Callable[[], Any], theirs: Callable[[], Any]) -> tuple[float, float]:
    """The middle wall time of each, s: a slow minute of the machine is both sides' minute."""
    ours()
    spent: tuple[list[float], list[float]] = ([], [])
    for of_whom in (0, 0, 1, 0) * 3:
        start = time.perf_counter()
        (theirs if of_whom else ours)()
        spent[of_whom].append(time.perf_counter() - start)
    return statistics.median(spent[0]), statistics.median(spent[1])


def _unlike(ours: list[Spikes], starts: NDArray[np.int64], samples: NDArray[np.int32]) -> int:
    """How many trains of ours are not NumPy's: SA of all trials' taxels, then RA."""
    trains = [spikes.train(c * N_TAXELS + k) for c in range(2) for spikes in ours for k in TAXELS]
    theirs = np.split(samples, starts[1:-1])
    return sum(not np.array_equal(*both) for both in zip(trains, theirs, strict=True))


def _against_brian2(trials: Trials, folder: Path) -> Iterator[dict[str, Any]]:
    explicit, unit = PRESETS["explicit"], "ns/neuron-ms"
    np.save(folder / "all.npy", np.hstack([currents(samples, explicit) for samples in trials]))
    ways = [("cpp", 1, ""), ("cython", 1, "")]
    if cores() > 1:
        ways.append(("cpp", cores(), "_all_cores"))
    for target, threads, suffix in ways:
        ours, theirs = [], []
        for _ in range(BRIAN2_RUNS):
            ours.append(best_of(3, partial(on_cores, threads, trials, explicit)))
            answer = ask_brian2(target, folder, "all", strict=False, threads=threads)
            theirs.append(answer["seconds"])
        peer = f"Brian2 {answer['brian2']} {target}"
        note = (
            f"{SCENE}; {threads} threads each; preset explicit; trains on both sides; Brian2 with "
            f"its default flags, compilation left out; the middle of {BRIAN2_RUNS} runs in turns"
        )
        both = [per_neuron_ms(statistics.median(times)) for times in (ours, theirs)]
        yield _peers.row(f"encoder.vs_brian2_{target}{suffix}", both[0], unit, peer, both[1], note)
    yield _differing_trains(trials, folder)


def _differing_trains(trials: Trials, folder: Path) -> dict[str, Any]:
    """Trains of the explicit preset whose spikes are not all in Brian2's samples."""
    explicit = PRESETS["explicit"]
    some = trials[: -(-COMPARED_TRAINS // (2 * N_TAXELS))]
    drive = np.hstack([currents(samples, explicit) for samples in some])
    np.save(folder / "some.npy", drive[:, :COMPARED_TRAINS])
    answer = ask_brian2("cpp", folder, "some", strict=True)
    theirs = np.load(folder / "some.npz")
    ours = [s.train(row) for s in encode_trials(some, RANGES, explicit) for row in range(36)]
    differing = sum(
        not np.array_equal(train, np.sort(theirs["sample"][theirs["neuron"] == index]))
        for index, train in enumerate(ours[:COMPARED_TRAINS])
    )
    peer = f"Brian2 {answer['brian2']} cpp, fast-math off"
    note = f"of {COMPARED_TRAINS} SA and RA trains of 10 s, {answer['spikes']} spikes in all"
    return _peers.row("encoder.differing_trains", differing, "trains", peer, 0, note)


def ask_brian2(
    target: str, folder: Path, name: str, *, strict: bool, threads: int = 1
) -> dict[str, Any]:
    """Run Brian2 on the currents ``name``.npy in a folder; spikes go to ``name``.npz."""
    source, destination = str(folder / f"{name}.npy"), str(folder / f"{name}.npz")
    arguments = (target, source, destination, str(int(strict)), str(threads))
    return _peers.ask("_brian2_scene.py", *arguments, threads=threads)
