"""MATLAB files from a stranger are read as far as they hold what they claim, or refused."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rigctl.errors import WrongUse
from rigctl.exchange.matlab.matlab_reader import read_mat

HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
ROWS = np.arange(12.0).reshape(4, 3)


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<2I", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(kind: int, shape: tuple[int, ...], *contents: bytes) -> bytes:
    flags = element(6, struct.pack("<2I", kind, 0))
    sizes = element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, flags + sizes + element(1, b"x") + b"".join(contents))


def nested(depth: int) -> bytes:
    inner = matrix(6, (1, 1), element(9, bytes(8)))
    for _ in range(depth):
        inner = matrix(1, (1, 1), inner)
    return inner


def compressed(content: bytes) -> bytes:
    packed = zlib.compress(content)
    return struct.pack("<2I", 15, len(packed)) + packed


HUGE = 0x7FFFFFFF
IMPOSSIBLE = {
    "cells": matrix(1, (HUGE, 1)),
    "compressed cells": compressed(matrix(1, (HUGE, HUGE))),
    "blanks": matrix(4, (1, HUGE), element(16, b"")),
    "structures": matrix(2, (HUGE, 1), element(5, struct.pack("<i", 32)), element(1, b"")),
    "numbers": matrix(6, (HUGE, HUGE), element(9, bytes(8))),
    "negative": matrix(6, (-1, -1), element(9, bytes(8))),
    "a bomb": compressed(matrix(6, (1, 1), element(9, bytes(300_000_000)))),
    "deep": nested(10_000),
    "functions": matrix(16, (1, 1)),
    "nothing": b"\x0e\0\0\0",
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_variables_are_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(HEADER + IMPOSSIBLE[name])
    with pytest.raises(WrongUse, match="is not a MATLAB file, or is damaged") as caught:
        read_mat(path)
    assert len(str(caught.value)) < 400


def test_every_truncated_file_is_refused_or_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"run": {"a": ROWS, "note": "x"}, "cells": [1, "a"]}, do_compression=True)
    assert {"run.a", "run.note"} <= set(read_mat(path))
    whole = path.read_bytes()
    for end in range(0, len(whole) - 1, 7):
        path.write_bytes(whole[:end])
        try:
            read_mat(path)
        except WrongUse as error:
            assert str(path) in str(error)


def test_a_matlab_4_file_is_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"x": ROWS}, format="4")
    with pytest.raises(WrongUse, match="no header of MATLAB 5"):
        read_mat(tmp_path / "a.mat")


def test_data_in_another_file_are_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(range(96)))
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", (96,), "u1", external=[(str(secret), 0, 96)])
    with pytest.raises(WrongUse, match="/x is stored outside the file"):
        read_mat(path)
    with h5py.File(path, "w") as file:
        file["x"] = h5py.ExternalLink(str(path), "/y")
    with pytest.raises(WrongUse, match="/x is a link"):
        read_mat(path)


def test_cells_of_themselves_and_a_crowd_of_cells_end_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        cells = file.create_dataset("cells", (2, 1), h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        cells[0, 0] = cells[1, 0] = cells.ref
    with pytest.raises(WrongUse, match="nested more than"):
        read_mat(path)
    with h5py.File(path, "w") as file:
        file["#refs#/a"] = np.zeros(1_000_000)
        cells = file.create_dataset("cells", (100, 1), h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        cells[:] = np.full((100, 1), file["#refs#/a"].ref, h5py.ref_dtype)
    with pytest.raises(WrongUse, match="too much memory"):
        read_mat(path)


def test_other_types_have_a_name_and_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        file["x"] = ROWS.T
        file["complex"] = np.zeros(3, complex)
        file["words"] = "of any length"
        file["words"].attrs["MATLAB_fields"] = "of any length"
    variables = read_mat(path)
    np.testing.assert_array_equal(variables["x"], ROWS)
    assert variables["complex"].dtype == variables["words"].dtype == object
