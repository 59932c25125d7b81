"""What one seed gives on a processor with AVX-512 and on one with AVX2: readings to accuracies.

Two programs simulate the same virtual set and analyse it, one as on a processor with AVX2 alone.
That one also analyses the readings of the first, which tells the bench from the analysis.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.representations import represent
from rigctl.analysis.tasks import SweepSettings, run_tasks
from rigctl.analysis.trial_set import join_sessions, open_trials
from rigctl.cli import main as rigctl
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.parameters import DEFAULT
from tests.encoder.processors import CACHES, haswell_environment

PLAN = Path(__file__).parents[3] / "protocols" / "quick.toml"
DRAWS, COMPONENTS = 5, 10
SCENE = (
    "virtual set of protocols/quick.toml, 4 repeats, seed 1, on a processor with AVX-512 and as on "
    "one with AVX2 alone"
)
Found = dict[str, NDArray[Any]]


def analyse_set(session: Path) -> Found:
    """Return a session's readings, a checksum of each train, C, features and accuracies."""
    trials = join_sessions([session])
    with open_trials(trials.files) as reader, TemporaryDirectory() as folder:
        samples = [reader.read(trial) for trial in trials.trials]
        found = represent(trials, DEFAULT, Path(folder))
        results, _ = run_tasks(found, SweepSettings(iterations=DRAWS, k_max=COMPONENTS))
        features = np.concatenate([found.features(one).ravel() for one in found.present])
    spikes = encode_trials(samples, found.normalisation)
    trains = [crc32(one.train(row).tobytes()) for one in spikes for row in range(one.n_trains)]
    assert found.force is not None
    return {
        "readings": np.concatenate([one.ravel() for one in samples]).astype(np.int64),
        "trains": np.array(trains, np.int64),
        "C": found.force.c.ravel(),
        "features": features,
        "accuracies": 100
        * np.concatenate([one.mean for result in results for one in result.curves]),
    }


def measure() -> Iterator[dict[str, Any]]:
    """Yield what differs with the readings of one processor, then with each one's own."""
    haswell = haswell_environment()
    if haswell is None:
        return
    here = {**os.environ, "NUMBA_CACHE_DIR": str(CACHES / "here")}
    with TemporaryDirectory() as name:
        folder = Path(name)
        for environment, words in (
            (here, ("set", "first.npz")),
            (haswell, ("set", "same.npz")),
            (haswell, ("other", "own.npz")),
        ):
            command = [sys.executable, "-m", __name__, *(str(folder / word) for word in words)]
            subprocess.run(command, env=environment, check=True)
        first, same, own = (
            dict(np.load(folder / f"{name}.npz")) for name in ("first", "same", "own")
        )
    yield from differences("same_readings", first, same, 0.0)
    yield from differences("own_readings", first, own, None)


def differences(
    which: str, first: Found, other: Found, limit: float | None
) -> Iterator[dict[str, Any]]:
    """Yield the share of each that differs, in per cent, and by how much at most."""
    for what, values in first.items():
        theirs = other[what]
        figure: dict[str, Any] = {
            "name": f"processors.{which}.{what.lower()}_differing",
            "unit": "%",
        }
        apart = np.abs(values - theirs)
        figure |= {"value": round(100 * float(np.mean(apart > 0)), 3), "limit": limit}
        if what != "trains":
            figure["largest"] = float(f"{apart.max():.3g}")
        yield {**figure, "scene": SCENE}


if __name__ == "__main__":
    session, out = map(Path, sys.argv[1:])
    plan = ("--plan", str(PLAN), "--repeats", "4", "--seed", "1")
    if not session.exists():
        rigctl(["synth", *plan, "--out", str(session)])
    arrays: dict[str, Any] = analyse_set(session)
    np.savez(out, **arrays)
