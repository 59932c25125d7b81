"""Write the Brian2 trains that the suite compares with ours spike by spike.

``RIGCTL_PEERS_PYTHON=.peers/bin/python python -m tests.encoder.golden`` writes
``brian2_explicit.npz``: four trials of six taxels, read at 1 kHz for two seconds, and the samples
in which each of their 48 neurons spiked in Brian2's C++ with fast-math and contraction off.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.parameters import PRESETS
from tests.benchmarks.encoder import _peers
from tests.benchmarks.encoder.encoder import run_brian2
from tests.benchmarks.encoder.numpy_encoder import currents

FILE = Path(__file__).with_name("brian2_explicit.npz")
N_TRIALS, N_SAMPLES, N_TAXELS = 4, 2000, 6
FLAGS = "cpp_standalone, -O3 -fno-fast-math -ffp-contract=off, method euler, dt 0.25 ms"


def readings() -> NDArray[np.uint16]:
    """Return readings (trials, samples, taxels): waves, contact made and lost, noise."""
    rng = np.random.default_rng(7)
    t = np.arange(N_SAMPLES)[:, None] / 1000
    trials = []
    for trial in range(N_TRIALS):
        wave = np.sin(2 * np.pi * rng.uniform(3, 40, N_TAXELS) * t + rng.uniform(0, 6, N_TAXELS))
        x = rng.uniform(0.1, 0.8, N_TAXELS) + rng.uniform(0.02, 0.3, N_TAXELS) * wave
        x += rng.normal(0, 0.02 * trial, x.shape)
        x[:150] = x[1800:] = 0.02
        trials.append(np.round(1023 * np.clip(x, 0, 1)).astype(np.uint16))
    return np.stack(trials)


def make() -> None:
    """Run Brian2 and write the file."""
    samples = readings()
    drive = np.hstack([currents(trial, PRESETS["explicit"]) for trial in samples])
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "golden.npy", drive)
        answer = run_brian2("cpp", Path(folder), "golden", strict=True)
        brian2 = np.load(Path(folder) / "golden.npz")
        spikes = {"neuron": brian2["neuron"], "sample": brian2["sample"]}
    order = np.lexsort((spikes["sample"], spikes["neuron"]))
    np.savez_compressed(
        FILE,
        samples=samples,
        neuron=spikes["neuron"][order].astype(np.uint16),
        sample=spikes["sample"][order].astype(np.uint16),
        made_by=np.array(f"Brian2 {answer['brian2']}, {FLAGS}"),
    )
    print(f"{FILE.name}: {len(order)} spikes of {drive.shape[1]} neurons, {FLAGS}")


if __name__ == "__main__":
    if not _peers.available():
        raise SystemExit(_peers.ABSENT)
    make()
