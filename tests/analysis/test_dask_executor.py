"""The analysis on a real Dask cluster of two processes, some of which the tests kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from threadpoolctl import threadpool_info

from rigctl.analysis import executors
from rigctl.analysis.cache import Resources
from rigctl.analysis.executors import SERIAL, local_executor
from rigctl.analysis.representations import represent
from rigctl.analysis.tasks import SweepSettings, TaskResult, run_tasks
from rigctl.analysis.trial_set import join_sessions
from rigctl.cli import main
from rigctl.cli.progress import ProgressLine
from rigctl.encoder.parameters import DEFAULT
from rigctl.errors import WorkersLost, WrongUse
from tests.analysis.recordings import record

pytest.importorskip("distributed")
SETTINGS = SweepSettings(iterations=3, k_max=3, tasks=("textures", "extrapolation"))


class Cluster(NamedTuple):
    process: subprocess.Popen[str]
    two: str
    none: str
    pids: list[int]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    yield record(
        tmp_path_factory.mktemp("dask") / "session", "AB", repeats=2, travel_mm=12.0,
        speeds=(40, 60, 80, 120), forces=(250, 500, 1000),
    )  # fmt: skip


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.analysis.local_cluster"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    with process:
        assert process.stdout is not None
        yield Cluster(process, **json.loads(process.stdout.readline()))
        process.kill()


def outcomes(results: list[TaskResult]) -> list[tuple[str, str, bytes, bytes]]:
    return [
        (r.task.key, c.representation.key, c.accuracy.tobytes(), c.confusion.tobytes())
        for r in results
        for c in r.curves
    ]


def test_results_are_equal_although_a_worker_is_killed(
    cluster: Cluster, session: Path, tmp_path: Path
) -> None:
    folders = tmp_path / "alone", tmp_path / "together"
    for folder in folders:
        folder.mkdir()
    trials = join_sessions([session])
    alone = represent(trials, DEFAULT, folders[0])
    steps: list[tuple[str, int]] = []

    def progress(stage: str, done: int, all_: int) -> None:
        if stage == "classifying" and done == all_ // 4:
            os.kill(cluster.pids[0], signal.SIGKILL)
        steps.append((stage, done))

    with executors.dask_executor(cluster.two) as executor:
        assert executor.is_local
        executor.check_visible([session, tmp_path])
        resources = Resources(executor, progress=progress)
        together = represent(trials, DEFAULT, folders[1], resources=resources)
        results, _ = run_tasks(together, SETTINGS, resources)
    assert {key: path.read_bytes() for key, path in alone.files.items()} == {
        key: path.read_bytes() for key, path in together.files.items()
    }
    assert outcomes(results) == outcomes(run_tasks(alone, SETTINGS)[0])
    assert [n for stage, n in steps if stage == "classifying"] == list(range(2 * 8 * 3 + 1))


def test_a_worker_that_does_not_fit_is_refused_by_name(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nowhere = tmp_path / "nowhere"
    with executors.dask_executor(cluster.two) as executor:
        with pytest.raises(WrongUse, match=f"worker tcp://.* does not see {nowhere}"):
            executor.check_visible([tmp_path, nowhere])
        monkeypatch.setattr(executors, "_list_folder", lambda folder: [("part-0001.h5", 7)])
        with pytest.raises(WrongUse, match=f"does not see {tmp_path} with its files"):
            executor.check_visible([tmp_path])
        monkeypatch.setattr(executors, "__version__", "9.9.9")
        executors.own_versions.cache_clear()
        with pytest.raises(WrongUse, match=r"worker tcp://.* has rigctl .*, this machine 9\.9\.9"):
            list(executor.map(abs, [-1]))
    with (
        pytest.raises(WrongUse, match=r"worker tcp://.* has rigctl"),
        executors.dask_executor(cluster.two),
    ):
        pass
    executors.own_versions.cache_clear()


def test_an_error_of_a_task_passes_unchanged(cluster: Cluster) -> None:
    with (
        executors.dask_executor(cluster.two) as executor,
        pytest.raises(FileNotFoundError, match="no-such-folder"),
    ):
        list(executor.map(os.listdir, ["/no-such-folder"]))


def test_an_interruption_cancels_the_remaining_tasks(cluster: Cluster, session: Path) -> None:
    from distributed import Client

    def interrupt(stage: str, done: int, all_: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    trials = join_sessions([session])
    with pytest.raises(KeyboardInterrupt), executors.dask_executor(cluster.two) as executor:
        resources = Resources(executor, progress=interrupt)
        represent(trials, DEFAULT, session.parent, resources=resources)
    with Client(cluster.two, set_as_default=False) as client:
        assert not any(client.who_has().values())
        assert client.submit(abs, -1).result() == 1


def test_an_address_without_workers_is_refused(
    cluster: Cluster, session: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.setattr(executors, "CONNECT_S", 2.0)
    command = ["analyse", str(session), "--out", str(session.parent / "r"), "--dask"]
    for address, message in (
        ("nowhere", "is not the address of a Dask scheduler"),
        ("tcp://[", "is not the address of a Dask scheduler"),
        ("tcp://127.0.0.1:1", "no scheduler answers at tcp://127.0.0.1:1"),
        (cluster.none, "has no workers: start some"),
    ):
        assert main([*command, address]) == 2
        assert message in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main([*command, cluster.two]) == 2
    assert "pip install 'rigctl[dask]'" in capsys.readouterr().err


def test_a_long_wait_for_workers_ends(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import Client

    monkeypatch.setattr(executors, "POLL_S", 0.05)
    with Client(cluster.none, set_as_default=False) as client:
        executor = executors.DaskExecutor(client, set())
        with pytest.raises(WorkersLost, match="has had no worker"):
            list(executor.map(abs, [-1]))


def test_a_lost_scheduler_is_reported_in_one_sentence(
    cluster: Cluster, session: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    """This is the last test of the file: it ends the cluster."""
    out = session.parent / "lost"
    shown = ProgressLine.show_stage

    def show(line: ProgressLine, stage: str, done: int, all_: int) -> None:
        shown(line, stage, done, all_)
        if stage.startswith("searching") and done == 1:
            cluster.process.kill()

    monkeypatch.setattr(ProgressLine, "show_stage", show)
    assert main(["analyse", str(session), "--out", str(out), "--dask", cluster.two]) == 3
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"rigctl: the Dask scheduler {cluster.two} is gone: start it again")
    assert sorted(p.name for p in session.parent.iterdir() if "lost" in p.name) == []


def blas_threads(_task: int) -> list[int]:
    """Return the threads of each BLAS library: NumPy's and SciPy's own."""
    from scipy import linalg

    linalg.eigvalsh([[2.0, 1.0], [1.0, 2.0]])
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_blas_uses_one_thread_in_every_process() -> None:
    with local_executor(2) as executor:
        found = list(executor.map(blas_threads, range(4)))
    assert found == [[1, 1]] * 4
    assert list(SERIAL.map(blas_threads, [0])) == [[1, 1]]
