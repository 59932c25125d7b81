"""MATLAB files from a stranger are read as far as they hold what they claim, or refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rigctl.errors import WrongUse
from rigctl.exchange.matlab import read_mat

ROWS = np.arange(12.0).reshape(4, 3)


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


def test_data_in_another_file_are_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(range(96)))
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", (96,), "u1", external=[(str(secret), 0, 96)])
    with pytest.raises(WrongUse, match="/x is stored outside"):
        read_mat(path)
    with h5py.File(path, "w") as file:
        file["x"] = h5py.ExternalLink(str(path), "/y")
    with pytest.raises(WrongUse, match="x is a link"):
        read_mat(path)


def test_cells_of_themselves_end_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w") as file:
        cells = file.create_dataset("cells", (2, 1), h5py.ref_dtype)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        cells[0, 0] = cells[1, 0] = cells.ref
    with pytest.raises(WrongUse, match="nested more than"):
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
