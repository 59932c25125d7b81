"""A feature matrix that is written a few rows at a time is a plain .npy file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigctl.analysis.data.feature_file import FeatureFile


def test_written_rows_are_read_back_and_others_are_zero(tmp_path: Path) -> None:
    path = tmp_path / "features.npy"
    expected = np.zeros((12, 7))
    file = FeatureFile(path, 12, 7)
    for seed, rows in enumerate(([1, 2, 3], [0, 5, 6, 9], [11])):
        buffer = file.buffer(len(rows))
        buffer[:] = expected[rows] = np.random.default_rng(seed).normal(size=(len(rows), 7))
        file.write(rows, buffer)
    file.close(sync=True)
    for mode in (None, "r"):
        found = np.load(path, mmap_mode=mode)
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, expected)
    again = tmp_path / "again.npy"
    np.save(again, expected)
    assert path.read_bytes() == again.read_bytes()
