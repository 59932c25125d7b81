"""Linear algebra on one thread: several would only wait for each other on a busy machine."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(autouse=True)
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread during a test."""
    with threadpool_limits(1, "blas"):
        yield
