"""Measure the encoder with one piece of its kernel replaced by something simpler.

``python -m tests.benchmarks.encoder.ablation`` copies the package once for each piece, replaces the
piece, and lets all copies take turns. It prints CPU time over that of the whole kernel, the median
of the rounds. With ``avx2`` as an argument numba compiles for a processor without AVX-512.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.encoder.batch import (
    common_bin_edges,
    count_spikes,
    count_spikes_without_and_with_c,
    single_bin_edges,
)
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import SPEED_SCALED, UNSCALED
from rigctl.encoder.parameters import DEFAULT, PRESETS
from tests.benchmarks.encoder.encoder import N_SAMPLES, N_TAXELS, N_TRIALS, RANGES, scene

ROOT = Path(__file__).parents[3]
ROUNDS, REPEATS = 5, 5
AVX2 = "+avx,+avx2,+bmi,+bmi2,+cmov,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse4.1,+sse4.2,+ssse3"

# Piece: file of the kernel, its text, and the text that replaces it.
PIECES = {
    "whole kernel": ("simd.py", "", ""),
    "prefetch of readings in place": (
        "machine_code.py",
        "                    prefetch_sample(segments, row_bytes, t + CHUNK_SAMPLES)\n",
        "",
    ),
    "prefetch of copied readings": (
        "prefetch.py",
        "                _prefetch(address + ahead)\n",
        "",
    ),
    "runs beyond a block's own lanes": (
        "prefetch.py",
        "width = RUN if end - begin >= RUN else 1",
        "width = RUN if begin <= first and end >= first + RUN else 1",
    ),
    "stores in order (AVX2)": ("neuron_step.py", "if not HAS_AVX512:", "if False:"),
    "masks blended here (AVX2)": ("spike_counters.py", "if not HAS_AVX2:", "if True:"),
    "blended masks (AVX2)": (
        "spike_counters.py",
        "# The lane of each",
        "HAS_AVX512 = True\n# The lane of each",
    ),
}


def scenes() -> dict[str, Callable[[], Any]]:
    """Return what is measured: trains of two presets, and counts as the features need them."""
    trials, rng = scene(), np.random.default_rng(1)
    scale = rng.uniform(0.5, 2, (N_TRIALS, N_TAXELS))
    edges, few = common_bin_edges([SPEED_SCALED, UNSCALED], N_SAMPLES, 80.0), np.array([3, 9, 14])
    one_bin = single_bin_edges(trials)
    return {
        "trains": lambda: encode_trials(trials, RANGES),
        "trains, explicit": lambda: encode_trials(trials, RANGES, PRESETS["explicit"]),
        "counts": lambda: count_spikes_without_and_with_c(trials, edges, RANGES, DEFAULT, scale),
        "3 taxels": lambda: count_spikes(trials, one_bin, RANGES, taxels=few, sa_only=True),
    }


def cpu_times_s() -> dict[str, float]:
    """Return the shortest CPU time of each scene in this process, s."""
    shortest = {}
    for name, encode in scenes().items():
        encode()
        times = []
        for _ in range(REPEATS):
            start = time.process_time()
            encode()
            times.append(time.process_time() - start)
        shortest[name] = min(times)
    return shortest


def copy_without(piece: str, folder: Path) -> Path:
    """Return a copy of the packages in which a piece of the kernel is replaced."""
    ignore = shutil.ignore_patterns("__pycache__")
    for package in ("rigctl", "tests/benchmarks"):
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    (folder / "tests" / "__init__.py").touch()
    name, text, simpler = PIECES[piece]
    file = folder / "rigctl" / "encoding" / "kernel" / name
    source = file.read_text()
    if text not in source:
        raise SystemExit(f"{piece}: {name} no longer holds {text!r}")
    file.write_text(source.replace(text, simpler) if text else source)
    return folder


def measure_copy(folder: Path, avx2: bool) -> dict[str, float]:
    """Return the CPU times of a copy, from a process of its own."""
    caches = {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(folder)}
    host = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": AVX2} if avx2 else {}
    command = [sys.executable, "-m", "tests.benchmarks.encoder.ablation", "times"]
    environment = {**os.environ, **caches, **host}
    ran = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=True)
    times: dict[str, float] = json.loads(ran.stdout.splitlines()[-1])
    return times


def main(avx2: bool) -> None:
    """Print a row for each piece, a column for each scene."""
    with tempfile.TemporaryDirectory() as name:
        copies = {p: copy_without(p, Path(name) / str(i)) for i, p in enumerate(PIECES)}
        rounds = [{p: measure_copy(copies[p], avx2) for p in PIECES} for _ in range(ROUNDS)]
    columns = list(rounds[0]["whole kernel"])
    print("| without | " + " | ".join(columns) + " |\n|---|" + "---:|" * len(columns))
    for piece in PIECES:
        ratios = (
            statistics.median(r[piece][c] / r["whole kernel"][c] for r in rounds) for c in columns
        )
        print(f"| {piece} | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |")


if __name__ == "__main__":
    if sys.argv[1:] == ["times"]:
        print(json.dumps(cpu_times_s()))
    else:
        main(sys.argv[1:] == ["avx2"])
