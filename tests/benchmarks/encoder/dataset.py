"""Benchmark features of the paper's 24,000 trials: time, memory, and whether both grow linearly.

``rigctl synth`` generates the set once in ``build/bench-set``; ``RIGCTL_BENCH_SET`` names an
existing one. Each size runs in its own process.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.analysis.trial_set import TrialSet, join_sessions
from rigctl.encoder.features import SPEED_SCALED, UNSCALED
from rigctl.encoder.parameters import DEFAULT
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.benchmarks.encoder._peers import row
from tests.benchmarks.encoder.encoder import best_of
from tests.benchmarks.encoder.numpy_encoder import currents, numpy_spikes

SIZES = (3_000, 6_000, 12_000, 24_000)
WORKERS = 2
REPEATS = 4
PEER_TRIALS = 3
SET = Path(os.environ.get("RIGCTL_BENCH_SET", "build/bench-set"))


def measure() -> Iterator[dict[str, Any]]:
    """Yield the figures: factor, memory, linearity, second run, and opening the session."""
    ensure_dataset()
    print(f"# {describe_machine()}", file=sys.stderr)
    sizes = fastest_of_each([[compute_features(n) for n in SIZES] for _ in range(REPEATS)])
    largest = sizes[-1]
    factor = largest["trial_s"] / largest["four_s"]
    trials = join_sessions([SET])
    peer = peer_factor(trials)
    note = (
        f"{largest['trials']} trials, {largest['trial_s']:.0f} s; join, ranges, search of C, both "
        f"encodings, features of the paper's four representations; {WORKERS} threads; files in "
        f"memory, kernels loaded; all representations: {largest['six_s']:.2f} s; "
        f"best of {REPEATS} in turns with smaller sets; CPU {largest['cpu_s']:.1f} s; "
        f"{describe_machine()}, load {largest['load']:.1f}; "
        f"the peer encodes {PEER_TRIALS} trials with and without C, no search, extrapolated"
    )
    name = "h5py and NumPy, trial by trial"
    answer = row("dataset.realtime_factor", factor, "x trial time", name, peer, note)
    yield answer | {"ratio": factor / peer}
    memory = "peak resident memory of all processes, with mapped feature files"
    yield row("dataset.peak_memory_mib", largest["peak_mib"], "MiB", "", None, memory)
    yield from linearity_rows(sizes)
    yield second_run()
    yield open_session_row(trials)
    yield verify_row(trials)


def ensure_dataset() -> None:
    """Generate the set if it does not exist."""
    if "RIGCTL_BENCH_SET" in os.environ or (SET / "whole").exists():
        return
    words = ("synth", "--plan", "paper", "--seed", "1", "--resume", "--out", str(SET))
    subprocess.run([sys.executable, "-m", "rigctl", *words], check=True)
    (SET / "whole").touch()


def describe_machine() -> str:
    """Return processor, Python and library versions of this machine."""
    cpu = platform.processor() or platform.machine()
    lines = Path("/proc/cpuinfo")
    if lines.exists():
        found = [text for text in lines.read_text().splitlines() if text.startswith("model name")]
        cpu = found[0].partition(":")[2].strip() if found else cpu
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "h5py"))
    return f"{os.cpu_count()} x {cpu}, Python {platform.python_version()}, {libraries}"


def compute_features(n: int, cache_folder: str = "") -> dict[str, Any]:
    """Compute the features of ``n`` trials in a new process; return its measurements."""
    words = [str(SET), str(n), str(WORKERS), cache_folder]
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.encoder._features_of_set", *words],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def fastest_of_each(turns: list[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return the fastest measurement of each size, since other load only slows them down.

    Sizes take turns, so that a busy minute does not affect all measurements of one size.
    """
    sizes = zip(*turns, strict=True)
    return [min(answers, key=lambda answer: float(answer["four_s"])) for answers in sizes]


def linearity_rows(sizes: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the largest deviation of time and memory from a line over the size."""
    n = np.array([answer["trials"] for answer in sizes], np.float64)
    for key, unit in (("four_s", "s"), ("cpu_s", "s"), ("peak_mib", "MiB")):
        values = np.array([answer[key] for answer in sizes])
        slope, start = np.polyfit(n, values, 1)
        worst = float(np.abs(values - (start + slope * n)).max() / values[-1])
        measured = ", ".join(f"{int(m):,}: {v:.2f}" for m, v in zip(n, values, strict=True))
        note = f"{measured} {unit}; line: {start:.2f} + {1000 * slope:.3f} per 1,000 trials"
        yield row(f"dataset.off_the_line.{key}", worst, "of the largest", "", None, note)


def second_run() -> dict[str, Any]:
    """Measure the set with a cache, which the first run fills and the second reads."""
    with tempfile.TemporaryDirectory(dir=SET.parent) as cache:
        first, second = (compute_features(SIZES[-1], cache) for _ in range(2))
        size = sum(path.stat().st_size for path in Path(cache).glob("??/*")) / 2**20
    note = (
        f"{SIZES[-1]} trials, all representations; {second['missed']} of "
        f"{second['missed'] + second['found']} pieces computed; the cache holds {size:.0f} MiB"
    )
    peer = "the first run, which fills it"
    return row("dataset.second_run_s", second["six_s"], "s", peer, first["six_s"], note)


def peer_factor(trials: TrialSet) -> float:
    """Return trial time over computing time of plain code: h5py slices, NumPy, bincount."""
    some = trials.trials[:PEER_TRIALS]
    start, n_samples = time.perf_counter(), 0
    for trial in some:
        file = trials.files[trial.sample_range.file]
        with h5py.File(file.path) as part:
            samples = part["taxels/samples"][trial.sample_range.start : trial.sample_range.stop]
        n_samples += len(samples)
        for factor in (1.0, 1.1):
            drive = currents(samples, DEFAULT)
            drive[:, : trials.n_taxels] *= factor
            counts = numpy_spikes(drive)
            for layout in (UNSCALED, SPEED_SCALED):
                windows = layout.sample_windows(len(samples), trial.speed_mm_s)
                for train in counts.T:
                    np.bincount(windows, train, minlength=layout.n_windows)
    return n_samples / 1000 / (time.perf_counter() - start)


def open_session_row(trials: TrialSet) -> dict[str, Any]:
    """Measure the time until all trials of the session can be read."""

    def ours() -> None:
        with Session.open(SET) as session:
            session.sample_files()
            session.sample_ranges(session.committed().tolist())

    def theirs() -> None:
        for path in sorted(SET.glob("part-*.h5")):
            with h5py.File(path) as part:
                rows = part["trials"][:]
                counters = part["taxels/counter"]
                for trial in rows:
                    last = int(trial["first_sample"]) + int(trial["count"]) - 1
                    _ = counters[last]

    note = (
        f"{len(trials.trials)} trials in {len(trials.files)} parts, files in memory: tables, "
        "texts, and completeness and position of each trial; best of 3"
    )
    peer = "h5py: tables, and the last counter of each trial"
    ours_s, theirs_s = best_of(3, ours), best_of(1, theirs)
    return row("open_session.24000_trials_s", ours_s, "s", peer, theirs_s, note)


def verify_row(trials: TrialSet) -> dict[str, Any]:
    """Measure a check of everything in the session, its digests included."""

    def theirs() -> None:
        for path in sorted(SET.glob("part-*.h5")):
            with path.open("rb") as file:
                hashlib.file_digest(file, "sha256")

    note = f"{len(trials.trials)} trials in {len(trials.files)} parts, files in memory; once"
    ours_s, theirs_s = best_of(1, lambda: verify(SET)), best_of(1, theirs)
    return row("verify.24000_trials_s", ours_s, "s", "SHA-256 of each file", theirs_s, note)
