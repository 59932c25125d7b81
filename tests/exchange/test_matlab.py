"""MATLAB files of both formats with structures, cells and texts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from rigctl.errors import WrongUse
from rigctl.exchange.matlab import read_mat
from rigctl.session.session import Session
from tests.exchange.test_import import PATTERN, run_import

N = 200
TABLE = np.random.Generator(np.random.Philox(2)).integers(0, 1024, (N, 3)).astype(float)
TIME_MS = np.arange(float(N))
WHOLE = {
    "run": {
        "clock": {"t": TIME_MS},
        "skin": TABLE,
        "load": np.full(N, 2.0),
        "who": "Jörg",
        "rate": 1000.0,
    },
    "notes": "by hand",
    "version": 3.0,
}
MAP = PATTERN + (
    '[time]\ncolumn = "run.clock.t"\nunit = "ms"\n[taxels]\ncolumns = ["run.skin1..run.skin3"]\n'
    '[loadcell]\ncolumn = "run.load"\nunit = "N"\n'
)


def write_73(path: Path, whole: dict[str, Any]) -> Path:
    """Write version 7.3 like MATLAB: structures as groups, texts as numbers, axes transposed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        _put(file, file, whole)
    return path


def _put(file: Any, group: Any, fields: dict[str, Any]) -> None:
    for name, value in fields.items():
        if isinstance(value, dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            _put(file, inner, value)
        elif isinstance(value, str):
            codes = np.array([[ord(letter)] for letter in value], np.uint16)
            group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
        elif isinstance(value, list) and isinstance(value[0], dict):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key in value[0]:
                inner.create_dataset(key, data=_references(file, [item[key] for item in value]))
        elif isinstance(value, list):
            cells = group.create_dataset(name, data=_references(file, value))
            cells.attrs["MATLAB_class"] = np.bytes_("cell")
        else:
            array = np.atleast_2d(value).astype(float)
            array = array.T if array.shape[0] == 1 else array
            data = group.create_dataset(name, data=array.T)
            data.attrs["MATLAB_class"] = np.bytes_("double")


def _references(file: Any, items: list[Any]) -> Any:
    hidden = file["#refs#"]
    references = []
    for item in items:
        name = f"x{len(hidden)}"
        _put(file, hidden, {name: item})
        references.append([hidden[name].ref])
    return np.array(references, h5py.ref_dtype)


def both(folder: Path, whole: dict[str, Any]) -> list[Path]:
    (folder / "old").mkdir()
    (folder / "new").mkdir()
    old, new = (folder / name / "silk_6cm_5N_1.mat" for name in ("old", "new"))
    savemat(old, whole)
    return [old, write_73(new, whole)]


def test_fields_of_structures_are_named_with_dots(tmp_path: Path) -> None:
    for number, path in enumerate(both(tmp_path, WHOLE)):
        folder, inspection = run_import(tmp_path, MAP, [path], f"s{number}")
        assert inspection.remarks == ()
        with Session.open(folder) as session:
            np.testing.assert_array_equal(session.samples(0), TABLE)
            assert session.drum(0).loadcell["force_g"].mean() == pytest.approx(203.94, abs=0.01)


def test_a_structure_can_be_the_variable(tmp_path: Path) -> None:
    text = PATTERN + ('[time]\ncolumn = "clock.t"\nunit = "ms"\n[taxels]\ncolumns = ["skin2"]\n')
    text = text.replace("[files]\n", '[files]\nvariable = "run"\n')
    for number, path in enumerate(both(tmp_path, WHOLE)):
        folder, _ = run_import(tmp_path, text, [path], f"s{number}")
        with Session.open(folder) as session:
            np.testing.assert_array_equal(session.samples(0), TABLE[:, 1:2])


def test_arrays_of_structures_and_cells_are_numbered_from_one(tmp_path: Path) -> None:
    trials = [{"skin": TABLE[:, k], "no": k + 1.0} for k in range(3)]
    whole: dict[str, Any] = {
        "trial": trials,
        "cells": [TIME_MS, "text", np.eye(2)],
    }
    taxels = '"trial.1.skin", "trial.2.skin", "trial.3.skin"'
    text = PATTERN + f'[time]\ncolumn = "cells.1"\nunit = "ms"\n[taxels]\ncolumns = [{taxels}]\n'
    mat5 = dict(whole)
    mat5["cells"] = np.array([TIME_MS, "text", np.eye(2)], dtype=object)
    kind = [("skin", object), ("no", object)]
    mat5["trial"] = np.array([(t["skin"], t["no"]) for t in trials], dtype=kind)
    (tmp_path / "old").mkdir()
    (tmp_path / "new").mkdir()
    old = tmp_path / "old" / "silk_6cm_5N_1.mat"
    savemat(old, mat5)
    new = write_73(tmp_path / "new" / old.name, whole)
    for number, path in enumerate((old, new)):
        folder, _ = run_import(tmp_path, text, [path], f"s{number}")
        with Session.open(folder) as session:
            np.testing.assert_array_equal(session.samples(0), TABLE)


def test_missing_variables_are_named(tmp_path: Path) -> None:
    for number, path in enumerate(both(tmp_path, WHOLE)):
        for old, new, message in (
            ("run.skin1..run.skin3", "run.skin1..run.skin4", r"no column 'run\.skin4'"),
            ("run.skin1..run.skin3", "run.who", r"run\.who holds no plain numbers"),
            ("run.clock.t", "run.rate", "are not columns of one length"),
        ):
            with pytest.raises(WrongUse, match=f"{path.parent.name}/silk.*{message}"):
                run_import(tmp_path, MAP.replace(old, new), [path], f"x{number}")
        absent = MAP.replace("[files]\n", '[files]\nvariable = "walk"\n')
        with pytest.raises(WrongUse, match=r"no variable 'walk': it has .*run\.clock\.t"):
            run_import(tmp_path, absent, [path], f"x{number}")


def test_truncated_matlab_files_raise_one_sentence(tmp_path: Path) -> None:
    for path in both(tmp_path, WHOLE):
        whole = path.read_bytes()
        for tenths in range(1, 10):
            path.write_bytes(whole[: len(whole) * tenths // 10])
            with pytest.raises(WrongUse, match=str(path)):
                run_import(tmp_path, MAP, [path], "cut")
    assert not (tmp_path / "cut").exists()


@pytest.mark.parametrize("compressed", [False, True])
def test_complex_sparse_and_empty_arrays_are_whole(tmp_path: Path, compressed: bool) -> None:
    values = {
        "complex": np.array([1 + 2j, 3]),
        "sparse": csc_matrix(np.eye(3)),
        "complex_sparse": csc_matrix(1j * np.eye(2)),
        "empty": np.zeros((0, 3)),
        "text": "x",
        "no_text": "",
        "cells": np.array([1.0, "two"], dtype=object),
    }
    savemat(tmp_path / "x.mat", values, do_compression=compressed)
    assert {name.split(".")[0] for name in read_mat(tmp_path / "x.mat")} == set(values)


def test_a_cell_of_73_that_is_no_array_is_read(tmp_path: Path) -> None:
    """A damaged file had it; MATLAB writes rows and columns."""
    with h5py.File(tmp_path / "x.mat", "w", userblock_size=512) as file:
        file["#refs#/a"] = np.ones((2, 3))
        cell = file.create_dataset("cells", (), h5py.ref_dtype)
        cell[()] = file["#refs#/a"].ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    assert np.array_equal(read_mat(tmp_path / "x.mat")["cells.1"], np.ones((3, 2)))
