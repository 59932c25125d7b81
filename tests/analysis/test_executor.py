"""Tasks in worker processes."""

from __future__ import annotations

from threadpoolctl import threadpool_info

from rigctl.analysis.executors import SERIAL, local_executor


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
