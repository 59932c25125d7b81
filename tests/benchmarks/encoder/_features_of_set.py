"""Compute features in a new process. Arguments: SESSION TRIALS WORKERS CACHE. Prints JSON.

The kernels are loaded and the files read once before the timer starts; joining the set is timed.
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

from rigctl.analysis.cache import Cache, Resources
from rigctl.analysis.executors import local_executor
from rigctl.analysis.representations import represent
from rigctl.analysis.trial_set import TrialSet, join_sessions
from rigctl.encoder.parameters import DEFAULT

WARM_TRIALS = 240


class StageTimes:
    """The start of each stage, s of ``perf_counter``."""

    def __init__(self) -> None:
        self.began: dict[str, float] = {}

    def show(self, stage: str, done: int, all_: int) -> None:
        """Store the time of a stage's first call."""
        self.began.setdefault(stage, time.perf_counter())


def take_evenly(trials: TrialSet, n: int) -> TrialSet:
    """Return ``n`` trials: the first repeats of every condition, equally many of each."""
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
                take_evenly(join_sessions(paths), WARM_TRIALS),
                DEFAULT,
                Path(folder),
                resources=Resources(executor),
            )
        stages, cpu = StageTimes(), time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            trials = take_evenly(join_sessions(paths), int(n))
            cache = Cache(Path(cache_folder) if cache_folder else None)
            resources = Resources(executor, cache, stages.show)
            made = represent(trials, DEFAULT, Path(folder), resources=resources)
            end = time.perf_counter()
            sizes = {key: file.stat().st_size for key, file in made.files.items()}
    four = stages.began["encoding with a given C"] - start
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
