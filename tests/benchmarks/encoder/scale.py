"""Measure what a trial costs in each step of the analysis, to extrapolate to very many trials.

Times are processor time, which load on the machine changes little; only the disk is timed by the
clock. ``python -m tests.benchmarks scale`` prints the rates;
``python -m tests.benchmarks.encoder.scale PAGE`` writes the page of docs/explanation from the
rates of that same run.
"""

from __future__ import annotations

import json
import os
import pickle
import shutil
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from rigctl.analysis import published
from rigctl.analysis.cache import Resources
from rigctl.analysis.executors import Executor, R, T
from rigctl.analysis.pca_lda import SweepEngine, predict_splits
from rigctl.analysis.representations import REPRESENTATIONS, represent
from rigctl.analysis.spike_counts import CHUNK, count_condition, group_by_condition, prepare_trials
from rigctl.analysis.splits import make_splits
from rigctl.analysis.trial_set import Design, TrialSet, join_sessions
from rigctl.encoder.parameters import DEFAULT
from tests.analysis.recordings import record
from tests.benchmarks.encoder import _scale_page
from tests.benchmarks.encoder._peers import row
from tests.benchmarks.encoder.fig3 import generate_features

SPEEDS, FORCES = (40, 60, 80, 100, 120), (250, 500, 1000)
REPEATS = 8
SWEEPS = (9_600, 19_200)
"""Trials of the two sets that give the slope of a draw's cost; each fit has > 2160 rows."""
WIDTHS = (720, 2160)
TASKS = 300
SYNCED_BYTES = 2**28


def measure() -> Iterator[dict[str, Any]]:
    """Yield one figure for each rate."""
    found = rates()
    note = f"{found['trials']} trials, {found['machine']}"
    for name, unit in _scale_page.UNITS.items():
        yield row(f"scale.{name}", found[name], unit, "", None, note)


def rates() -> dict[str, Any]:
    """Measure everything that the page needs."""
    with tempfile.TemporaryDirectory() as name, threadpool_limits(1, "blas"):
        folder = Path(name)
        session = record(
            folder / "session", "AB", repeats=REPEATS, travel_mm=240.0, speeds=SPEEDS, forces=FORCES
        )
        found: dict[str, Any] = {
            "made": time.strftime("%Y-%m-%d", time.gmtime()),
            "machine": _machine(),
        }
        found |= _session_rates(session) | _encoding_rates(join_sessions([session]), folder)
        found |= {"synced_bytes_s": _synced_bytes_s(folder), "disk_free_bytes": _free(folder)}
    return found | _draw_rates() | _dask_rates()


def _machine() -> str:
    model = next(
        (
            line.split(":", 1)[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        "processor",
    )
    return f"{os.cpu_count()} processors ({model}), load {os.getloadavg()[0]:.1f} at the start"


def _session_rates(session: Path) -> dict[str, Any]:
    """Measure bytes on disk, and time and memory of the table of trials."""
    begun = time.process_time()
    joined = join_sessions([session])
    took = time.process_time() - begun
    tracemalloc.start()
    again = join_sessions([session])
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    n = len(joined.trials)
    return {
        "trials": n,
        "session_bytes": sum(f.stat().st_size for f in session.iterdir()) / n,
        "join_s": took / n,
        "table_bytes": kept / len(again.trials),
        "draw_job_bytes": len(pickle.dumps(Design.from_trials(joined))) / n,
        "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        "chunk_trials": CHUNK,
    }


class _Timed(Executor):
    """A serial executor that adds up the processor time of its tasks."""

    work_s = 0.0

    def map(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """As :class:`Executor`, by the clock."""
        return super().map(partial(self._run, function), tasks)

    def map_nogil(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """As :class:`Executor`, by the clock."""
        return super().map_nogil(partial(self._run, function), tasks)

    def _run(self, function: Callable[[T], R], task: T) -> R:
        begun = time.process_time()
        result = function(task)
        self.work_s += time.process_time() - begun
        return result


def _encoding_rates(trials: TrialSet, folder: Path) -> dict[str, Any]:
    """Measure time of the tasks and of the first process, and the bytes of their results."""
    prepared = prepare_trials(trials, Resources())
    condition = group_by_condition(prepared, DEFAULT, 500.0, search_c=True)[0]
    counts = count_condition(condition)  # compiles the kernels
    took: dict[str, float] = {}
    for turn in ("first", "second"):
        out, executor = folder / turn, _Timed()
        out.mkdir()
        begun = time.process_time()
        made = represent(trials, DEFAULT, out, resources=Resources(executor))
        whole = time.process_time() - begun
        if not took or executor.work_s < took["work"]:
            took = {"work": executor.work_s, "beside": whole - executor.work_s}
    n, in_condition = len(trials.trials), len(condition.rows)
    samples = sum(condition.lengths) * trials.n_taxels * 2
    return {
        "encode_s": took["work"] / n,
        "write_s": took["beside"] / n,
        "counts_bytes": sum(a.nbytes for a in counts.values()) / in_condition,
        "feature_bytes": sum(f.stat().st_size for f in made.files.values()) / n,
        "condition_bytes": samples / in_condition
        + sum(a.nbytes for a in counts.values()) / in_condition,
        "condition_job_bytes": len(pickle.dumps(condition)) / in_condition,
    }


def _synced_bytes_s(folder: Path) -> float:
    """Return the bytes per second that the disk stores, with fsync."""
    data = os.urandom(2**20)
    begun = time.perf_counter()
    with (folder / "synced").open("wb") as file:
        for _ in range(SYNCED_BYTES // len(data)):
            file.write(data)
        file.flush()
        os.fsync(file.fileno())
    return SYNCED_BYTES / (time.perf_counter() - begun)


def _free(folder: Path) -> int:
    return shutil.disk_usage(folder).free


def _draw_rates() -> dict[str, Any]:
    """Fit a line over the size of the set to the cost of a draw of all tasks."""
    took, rows = [], 0.0
    for n in SWEEPS:
        whole = _design(n)
        seconds = 0.0
        for width in WIDTHS:
            features = generate_features(whole, width)
            same = sum((2160 if not r.speed_scaled else 720) == width for r in REPRESENTATIONS)
            for family in ("folds", "extrapolation"):
                fits = make_splits(whole, family, 0, 0)
                drawn = np.unique(np.concatenate([np.r_[f.train, *f.tests.values()] for f in fits]))
                rows = max(rows, len(drawn) / n)
                seconds += same * _sweep_s(features, whole, fits, family)
        took.append(seconds)
    slope = (took[1] - took[0]) / (SWEEPS[1] - SWEEPS[0])
    return {
        "draw_s": max(slope, 0.0),
        "draw_fixed_s": max(took[0] - slope * SWEEPS[0], 0.0),
        "draw_bytes": rows * WIDTHS[1] * 8,
        "sweep_trials": list(SWEEPS),
    }


def _sweep_s(features: Any, of: Design, fits: Any, family: str) -> float:
    labels = {task.key: of.labels(task) for task in published.TASKS if task.family == family}
    took = []
    for _ in range(2):
        begun = time.process_time()
        predict_splits(features, labels, fits, published.K_MAX, SweepEngine.OWN)
        took.append(time.process_time() - begun)
    return min(took)


def _design(n: int) -> Design:
    """Return ``n`` trials of the paper's 16 textures × 5 speeds × 3 forces."""
    grid = np.meshgrid(np.arange(16), SPEEDS, FORCES, np.arange(n // 240), indexing="ij")
    texture, speed, force = (axis.ravel() for axis in grid[:3])
    names = tuple("ABCDEFGHIJKLMNOP")
    return Design(names, texture.astype(np.int64), speed.astype(float), force.astype(float))


def _dask_rates() -> dict[str, Any]:
    """Measure what a task and its result cost scheduler and client, with two worker processes.

    Scheduler and client are threads of this process.
    """
    from distributed import LocalCluster

    from rigctl.analysis.executors import dask_executor

    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, dask_executor(cluster.scheduler_address) as executor:
        list(executor.map(abs, range(20)))
        begun = time.process_time()
        list(executor.map(abs, range(TASKS)))
        task_s = (time.process_time() - begun) / TASKS
        begun = time.process_time()
        got = sum(a.nbytes for a in executor.map(np.ones, [2**20] * 24))
        travelled = got / (time.process_time() - begun)
    return {"task_s": task_s, "travel_bytes_s": travelled}


def main(path: Path) -> None:
    """Write the page."""
    path.write_text(_scale_page.render(json.loads(json.dumps(rates()))), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
