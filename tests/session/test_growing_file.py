"""A file that grows while a reader checks it is not called damaged."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rigctl.session.hdf5_file import DataSetSchema, Hdf5File

ROWS = 100_000
WRITER = f"""
import sys, h5py
with h5py.File(sys.argv[1], "w", libver="latest") as file:
    file.create_dataset("small", data=[1, 2, 3])
    rows = file.create_dataset("rows", (0, 4), "i2", maxshape=(None, 4), chunks=(4096, 4))
    file.swmr_mode = True
    print("open", flush=True)
    sys.stdin.readline()
    rows.resize({ROWS}, 0)
    rows[:] = 7
    rows.flush()
    print("grown", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    arguments = [sys.executable, "-c", WRITER, str(tmp_path / "growing.h5")]
    with subprocess.Popen(
        arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stdout.readline() == "open\n"
        yield process
        assert process.stdin is not None
        process.stdin.close()


def test_rows_that_arrive_during_the_check_are_no_damage(
    tmp_path: Path, writer: subprocess.Popen[str]
) -> None:
    """A reader once compared the new number of rows with the size from before them."""

    def schemas() -> Iterator[DataSetSchema]:
        yield DataSetSchema("/small", 1)
        assert writer.stdin is not None and writer.stdout is not None
        print("go on", file=writer.stdin, flush=True)
        assert writer.stdout.readline() == "grown\n"
        yield DataSetSchema("/rows", 2)

    with Hdf5File(tmp_path / "growing.h5", swmr=True, libver="latest") as file:
        file.check(schemas())
        assert file.shape("/rows") == (ROWS, 4)
        assert np.all(file.rows("/rows") == 7)
