"""Recordings from elsewhere: CSV, NumPy, MATLAB and NWB files, imported with a map."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from rigctl.exchange.column_map import load_map
from rigctl.exchange.guess import guess_map
from rigctl.exchange.importer import import_files
from tests.fuzz.kind import Kind, Mutation, Place
from tests.fuzz.mutations.bytes import BYTES
from tests.fuzz.mutations.hdf5 import HDF5
from tests.fuzz.mutations.texts import TEXT

UTC = "2026-11-21T12:00:00Z"
STEM = "felt_12cm_2N_1"
PATTERN = r"""[files]
pattern = '(?P<texture>[a-z]+)_(?P<speed>-?\d+)cm_(?P<force>[\d.]+)N_(?P<repeat>\d+)'
"""
TIMED = PATTERN + '[time]\ncolumn = "t"\nunit = "ms"\n[taxels]\ncolumns = ["a..c"]\n'
RATED = PATTERN + '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["1..3"]\n'
NAMED = PATTERN + '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["run.a", "run.b"]\n'
ELEMENTS = (
    '[trials]\nelements = "trials"\n[time]\ncolumn = "time"\n[taxels]\ncolumns = ["skin1..skin3"]\n'
    '[labels]\ntexture_column = "texture"\nspeed_column = "speed"\n[loadcell]\ncolumn = "load"\n'
)
ROWS = np.arange(120)[:, None] * 3.25 + np.array([0.0, 100.0, 200.0])


def write_csv(path: Path) -> None:
    """Write a table with a time column."""
    rows = [f"{k},{a:g},{b:g},{c:g}" for k, (a, b, c) in enumerate(ROWS)]
    path.write_text("\n".join(["t,a,b,c", *rows]) + "\n")


def write_npy(path: Path) -> None:
    """Write one array."""
    np.save(path, ROWS)


def write_npz(path: Path) -> None:
    """Write an archive of arrays."""
    np.savez_compressed(path, t=np.arange(120.0), a=ROWS[:, 0], b=ROWS[:, 1], c=ROWS[:, 2])


def write_mat(path: Path) -> None:
    """Write a MATLAB 5 file with a structure."""
    savemat(path, {"run": {"a": ROWS[:, 0], "b": ROWS[:, 1], "note": "x"}, "cells": [1, "a"]})


def write_mat73(path: Path) -> None:
    """Write a MATLAB 7.3 file with a structure and cells."""
    with h5py.File(path, "w", libver=("v110", "v110")) as file:
        run = file.create_group("run")
        run.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, column in zip("ab", ROWS.T, strict=False):
            run[name] = column[None, :]
            run[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["#refs#/a"] = ROWS[:, :1].T
        cells = file.create_dataset("cells", (1, 2), h5py.ref_dtype)
        cells[0, 0] = cells[0, 1] = file["#refs#/a"].ref
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        file["text"] = np.array([[104], [105]], np.uint16)
        file["text"].attrs["MATLAB_class"] = np.bytes_("char")


def write_nwb(path: Path) -> None:
    """Write what the reader takes of an NWB file: two trials of a series, and a slower one."""
    with h5py.File(path, "w", libver=("v110", "v110")) as file:
        file["acquisition/skin/data"] = ROWS
        file["acquisition/skin/starting_time"] = 0.0
        file["acquisition/skin/starting_time"].attrs["rate"] = 1000.0
        file["acquisition/load/data"] = np.arange(9.0)
        file["acquisition/load/timestamps"] = np.arange(9) / 80
        file["general/keywords"] = np.array([b"tactile", b"simulated"])
        trials = file.create_group("intervals/trials")
        trials.attrs["colnames"] = ["start_time", "stop_time", "texture", "speed"]
        trials["start_time"], trials["stop_time"] = [0.0, 0.06], [0.05, 0.12]
        trials["texture"], trials["speed"] = np.array([b"felt", b"cork"], object), [40.0, 80.0]


def import_kind(
    name: str,
    suffix: str,
    write: Callable[[Path], None],
    text: str,
    mutations: tuple[Mutation, ...],
) -> Kind:
    """Return the kind of files with this suffix, imported into a new session."""

    def build(folder: Path) -> None:
        write(folder / f"{STEM}{suffix}")
        (folder / "map.toml").write_text(text)

    def import_file(folder: Path) -> object:
        out = folder / "session"
        shutil.rmtree(out, ignore_errors=True)
        paths = sorted(folder.glob(f"*{suffix}"))
        inspection, _ = import_files(paths, load_map(folder / "map.toml"), out, UTC)
        return inspection.remarks

    def guess_file(folder: Path) -> object:
        return guess_map(sorted(folder.glob(f"*{suffix}"))).text

    return Kind(name, build, (Place(f"{STEM}{suffix}", mutations),), (import_file, guess_file))


IMPORT_KINDS = (
    import_kind("csv", ".csv", write_csv, TIMED, TEXT),
    import_kind("npy", ".npy", write_npy, RATED, BYTES),
    import_kind("npz", ".npz", write_npz, TIMED, BYTES),
    import_kind("mat", ".mat", write_mat, NAMED, BYTES),
    import_kind("nwb", ".nwb", write_nwb, ELEMENTS, HDF5),
    import_kind("mat73", ".mat", write_mat73, NAMED, HDF5),
)
