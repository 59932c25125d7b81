"""Sessions to features in a fresh process: SESSION TRIALS WORKERS. Prints a JSON object.

Kernels are loaded and the files read once before the clock runs; the set is joined within it.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from rigctl.analysis.data.cache import Cache, Resources
from rigctl.analysis.data.trial_set import TrialSet, join_sessions
from rigctl.analysis.execution.executor import local_executor
from rigctl.analysis.features.representations import represent
from rigctl.encoding.parameters import DEFAULT

WARM_TRIALS = 240


class Stamps:
    """When each stage began, s of the clock, and CPU time with it."""

    def __init__(self) -> None:
        self.began: dict[str, float] = {}

    def show(self, stage: str, done: int, all_: int) -> None:
        """Take the time at a stage's first call."""
        self.began.setdefault(stage, time.perf_counter())


def evenly(trials: TrialSet, n: int) -> TrialSet:
    """The first repeats of every condition, so many that there are ``n`` trials."""
    conditions = {(t.texture, t.speed_mm_s, t.force_g) for t in trials.trials}
    most, seen, chosen = n // len(conditions), dict.fromkeys(conditions, 0), []
    for trial in trials.trials:
        key = (trial.texture, trial.speed_mm_s, trial.force_g)
        if seen[key] < most:
            chosen.append(trial)
        seen[key] += 1
    return replace(trials, trials=tuple(chosen))


def main(session: str, n: str, workers: str, cache_folder: str) -> None:
    paths = [Path(session)]
    for part in paths[0].glob("part-*.h5"):
        with part.open("rb") as file:
            while file.read(1 << 24):
                pass
    with local_executor(int(workers)) as executor:
        with tempfile.TemporaryDirectory() as folder:
            represent(
                evenly(join_sessions(paths), WARM_TRIALS),
                DEFAULT,
                Path(folder),
                resources=Resources(executor),
            )
        stamps, cpu = Stamps(), time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            trials = evenly(join_sessions(paths), int(n))
            cache = Cache(Path(cache_folder) if cache_folder else None)
            resources = Resources(executor, cache, stamps.show)
            made = represent(trials, DEFAULT, Path(folder), resources=resources)
            end = time.perf_counter()
            sizes = {key: file.stat().st_size for key, file in made.files.items()}
    four = stamps.began["encoding with a given C"] - start
    own, others = (
        resource.getrusage(who).ru_maxrss / 1024
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    answer = {
        "trials": len(trials.trials),
        "trial_s": sum(t.n_samples for t in trials.trials) / 1000,
        "four_s": four,
        "six_s": end - start,
        "cpu_s": time.process_time() - cpu,
        "peak_mib": own + others,
        "feature_bytes": sum(sizes.values()),
        "load": os.getloadavg()[0],
        "found": cache.hits,
        "missed": cache.misses,
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main(*sys.argv[1:])
