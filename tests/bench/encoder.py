"""The encoder beside Brian2 and NumPy: 36 neurons × 10 s × 100 trials, strict float64.

Brian2 and NumPy are handed the finished input currents; ours normalises, filters and
differentiates the integer readings within the measured time.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from rigctl.encoding import kernel
from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.lanes import WIDE, add, fma, full, store
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.presets import DEFAULT, PRESETS, EncoderParameters
from tests.bench import _peers

N_TRIALS, N_SAMPLES, N_TAXELS = 100, 10_000, 18
NEURON_MS = N_TRIALS * N_SAMPLES * 2 * N_TAXELS
COMPARED_TRAINS, PER_TRIAL_SAMPLE = 500, 2
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
    yield from _against_numpy(trials, ours)
    if not _peers.available():
        for name in ("vs_brian2_cpp", "vs_brian2_cython", "differing_trains"):
            yield _peers.row(f"encoder.{name}", ours, "ns/neuron-ms", "Brian2", None, _peers.ABSENT)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield from _against_brian2(trials, Path(folder))


def per_neuron_ms(seconds: float) -> float:
    """Time for the whole scene in ns for each neuron and ms."""
    return 1e9 * seconds / NEURON_MS


def on_all_cores(trials: Trials, parameters: EncoderParameters) -> None:
    """Trains of all trials, each core with a share of them; the kernels release the GIL."""
    n = cores()
    with ThreadPoolExecutor(n) as pool:
        shares = [trials[i::n] for i in range(n)]
        list(pool.map(lambda share: encode_trials(share, RANGES, parameters), shares))


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]  # numba has no type information
def _fused(times: Any, out: Any) -> None:
    """Nothing but fused multiply-adds: twelve vectors that do not wait for each other.

    As many as hide the latency, and no more than have room in sixteen registers.
    """
    a, b, c = full(out[0], 4), full(out[0], 4), full(out[0], 4)
    keep, new = full(0.999, 4), full(0.001, 4)
    for _ in range(times):
        a, b, c = fma(a, keep, new), fma(b, keep, new), fma(c, keep, new)
    store(out, 0, add(add(a, b), c))


def _limit(ours: float) -> dict[str, Any]:
    """How long the arithmetic alone would take at the processor's highest rate."""
    times, lanes = 2_000_000, 12 * WIDE
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


def currents(samples: NDArray[np.uint16], p: EncoderParameters) -> NDArray[np.float64]:
    """k·x of one trial by SciPy, float64 (n, 36): SA, then RA."""
    x = samples / 1023.0
    b, a = kernel.butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    smooth, _ = signal.lfilter(b, a, x, axis=0, zi=signal.lfilter_zi(b, a)[:, None] * x[0])
    slope = np.diff(smooth, axis=0, prepend=smooth[:1]) * p.sample_rate_hz
    return np.hstack([p.sa_gain * x, p.ra_gain * slope])


def numpy_spikes(drive: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The default scheme as a careful NumPy loop over time: drive (n, m) to counts (n, m)."""
    n, m = drive.shape
    v, u = np.full(m, -70.0), np.full(m, -14.0)
    counts = np.zeros((n, m), np.uint8)
    rise, fired = np.empty(m), np.empty(m, bool)
    for t in range(n):
        for _ in range(4):
            np.multiply(v, 0.04, out=rise)
            rise += 5.0
            rise *= v
            rise += 140.0
            rise -= u
            rise += drive[t]
            rise *= 0.25
            v += rise
            np.multiply(v, 0.2, out=rise)
            rise -= u
            rise *= 0.005
            u += rise
            np.greater_equal(v, 30.0, out=fired)
            if fired.any():
                v[fired] = -65.0
                u[fired] += 6.0
                counts[t] += fired
    return counts


def best_of(times: int, action: Callable[[], Any]) -> float:
    """Shortest wall time of an action, s, after one run to warm it."""
    action()
    shortest = float("inf")
    for _ in range(times):
        start = time.perf_counter()
        action()
        shortest = min(shortest, time.perf_counter() - start)
    return shortest


def _against_numpy(trials: Trials, ours: float) -> Iterator[dict[str, Any]]:
    unit = "ns/neuron-ms"
    all_drives = np.hstack([currents(samples, DEFAULT) for samples in trials])
    start = time.perf_counter()
    numpy_spikes(all_drives)
    batched = 1e9 * (time.perf_counter() - start) / NEURON_MS
    note = f"{SCENE}; one thread each"
    yield _peers.row("encoder.vs_numpy_batched", ours, unit, "NumPy, all trials", batched, note)
    start = time.perf_counter()
    for samples in trials[:PER_TRIAL_SAMPLE]:
        numpy_spikes(currents(samples, DEFAULT))
    spent = time.perf_counter() - start
    alone = 1e9 * spent / (PER_TRIAL_SAMPLE * N_SAMPLES * 2 * N_TAXELS)
    note = f"{note}; the peer measured on {PER_TRIAL_SAMPLE} of the trials"
    yield _peers.row("encoder.vs_numpy_per_trial", ours, unit, "NumPy, trial by trial", alone, note)


def _against_brian2(trials: Trials, folder: Path) -> Iterator[dict[str, Any]]:
    explicit, unit = PRESETS["explicit"], "ns/neuron-ms"
    np.save(folder / "all.npy", np.hstack([currents(samples, explicit) for samples in trials]))
    ours = {
        1: per_neuron_ms(best_of(3, lambda: encode_trials(trials, RANGES, explicit))),
        cores(): per_neuron_ms(best_of(3, lambda: on_all_cores(trials, explicit))),
    }
    ways = [("cpp", 1, ""), ("cython", 1, "")]
    if cores() > 1:
        ways.append(("cpp", cores(), "_all_cores"))
    for target, threads, suffix in ways:
        answer = ask_brian2(target, folder, "all", strict=False, threads=threads)
        peer = f"Brian2 {answer['brian2']} {target}"
        note = (
            f"{SCENE}; {threads} threads each; preset explicit; trains on both sides; Brian2 with "
            "its default flags, compilation left out"
        )
        theirs = per_neuron_ms(answer["seconds"])
        name = f"encoder.vs_brian2_{target}{suffix}"
        yield _peers.row(name, ours[threads], unit, peer, theirs, note)
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
