"""Windows of a buffered array are its rows, and the buffer stays small."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.session.part import BufferedArray

ROWS = np.arange(1000)


@given(st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 120)), max_size=30))
def test_windows_are_the_rows_of_the_array(windows: list[tuple[int, int]]) -> None:
    buffered = BufferedArray(lambda start, stop: ROWS[start:stop], len(ROWS))
    for start, count in windows:
        assert np.array_equal(buffered.window(start, start + count), ROWS[start : start + count])


def test_windows_in_order_are_read_about_once_in_blocks_of_limited_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rigctl.session.part.READ_AHEAD_ROWS", 200)
    reads: list[int] = []

    def read(start: int, stop: int) -> NDArray[Any]:
        reads.append(stop - start)
        return ROWS[start:stop]

    buffered = BufferedArray(read, len(ROWS))
    for start in range(0, 1000, 10):
        buffered.window(start, start + 10)
    assert max(reads) == 200
    assert sum(reads) < 1.1 * len(ROWS)
