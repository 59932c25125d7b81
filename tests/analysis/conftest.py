"""Linear algebra on one thread: several would only wait for each other on a busy machine."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rigctl.analysis.executors import limit_blas_threads


@pytest.fixture(autouse=True)
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread during a test."""
    with limit_blas_threads():
        yield
