"""Recordings of eight trials as other programs lay them out; every layout holds the same trials."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from tests.exchange.test_matlab import write_73

N_ROWS, N_TAXELS = 200, 9


class Recorded(NamedTuple):
    """One trial of every layout: ``counts`` float64 (200, 9), whole numbers."""

    texture: str
    speed_mm_s: int
    repeat: int
    counts: NDArray[np.float64]


def _counts(seed: int) -> NDArray[np.float64]:
    noise = np.random.Generator(np.random.Philox(seed)).normal(0, 4, (N_ROWS, N_TAXELS))
    return np.rint(500 + 10 * np.arange(N_TAXELS) + np.cumsum(noise, axis=0)).clip(0, 1023)


TRIALS = [
    Recorded(*condition, _counts(seed))
    for seed, condition in enumerate(product(("felt", "silk"), (20, 40), (1, 2)))
]
NAMES = [f"S{k + 1}" for k in range(N_TAXELS)]
TIME_MS = np.arange(float(N_ROWS))
TIME_S = TIME_MS / 1000


def write_rows(path: Path, header: str, rows: Any, delimiter: str = ",") -> Path:
    """Write a text table, without a header if that is empty."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [delimiter.join(str(cell) for cell in row) for row in rows]
    path.write_text("\n".join([header, *lines] if header else lines) + "\n")
    return path


def _whole(values: NDArray[np.float64]) -> list[list[int]]:
    return [[int(value) for value in row] for row in values]


def labels_in_names(folder: Path) -> None:
    """One file a trial, labels in its name, cells between semicolons, units below the names."""
    header = ";".join(["time_ms", *NAMES, "temperature"])
    header += "\n" + ";".join(["ms", *["mV"] * N_TAXELS, "°C"])
    for t in TRIALS:
        rows = np.c_[TIME_MS, t.counts, np.full(N_ROWS, 22)]
        name = f"{t.texture}_v{t.speed_mm_s}_r{t.repeat}.csv"
        write_rows(folder / name, header, _whole(rows), ";")


def folder_tree(folder: Path) -> None:
    """Folders of texture and speed, files of repeats, a normal force beside the taxels."""
    header = "\t".join(["Time (s)", *NAMES, "force_N"])
    for t in TRIALS:
        rows = [
            [f"{at:.3f}", *counts, f"{1 + at:.3f}"]
            for at, counts in zip(TIME_S, _whole(t.counts), strict=True)
        ]
        place = folder / t.texture / f"{t.speed_mm_s}mm_s" / f"trial{t.repeat}.tsv"
        write_rows(place, header, rows, "\t")


def trial_column(folder: Path) -> None:
    """One table of all trials, labels in columns, the speed in mm/min."""
    header = ",".join(["material", "feed_mm_min", "trial", "t", *NAMES])
    rows = [
        [t.texture, t.speed_mm_s * 60, number, f"{at:.3f}", *counts]
        for number, t in enumerate(TRIALS, 1)
        for at, counts in zip(TIME_S, _whole(t.counts), strict=True)
    ]
    write_rows(folder / "all.csv", header, rows)


def decimal_commas(folder: Path) -> None:
    """Lines about the recording, then a table with decimal commas."""
    for t in TRIALS:
        rows = [
            [f"{at:.3f}".replace(".", ","), *counts]
            for at, counts in zip(TIME_S, _whole(t.counts), strict=True)
        ]
        header = f"Skin 2, firmware 1.4\n\nOperator;Jörg\n{';'.join(['Zeit', *NAMES])}"
        name = f"{t.texture}_{t.speed_mm_s}mmps_{t.repeat}.txt"
        write_rows(folder / name, header, rows, ";")


def _structures() -> list[dict[str, Any]]:
    return [
        {
            "material": t.texture,
            "set": {"speed": float(t.speed_mm_s)},
            "skin": t.counts,
            "t": TIME_S,
        }
        for t in TRIALS
    ]


def structures(folder: Path) -> None:
    """An array of structures in MATLAB 5."""
    array = np.empty(len(TRIALS), object)
    array[:] = _structures()
    savemat(folder / "study.mat", {"data": {"trials": array, "who": "Jörg"}})


def structures_73(folder: Path) -> None:
    """An array of structures in MATLAB 7.3."""
    write_73(folder / "study.mat", {"data": {"trials": _structures()}})


def cells(folder: Path) -> None:
    """A cell array of tables for each condition, time in their first column."""
    for texture, speed in product(("felt", "silk"), (20, 40)):
        found = [t for t in TRIALS if (t.texture, t.speed_mm_s) == (texture, speed)]
        array = np.empty(len(found), object)
        array[:] = [np.c_[TIME_S, t.counts] for t in found]
        savemat(folder / f"{texture}_{speed / 10:g}cms.mat", {"runs": array})


def without_header(folder: Path) -> None:
    """A wide table for each trial without header, time in its first column."""
    for t in TRIALS:
        rows = np.c_[1000 * TIME_MS, t.counts]
        write_rows(folder / f"{t.texture}-{t.speed_mm_s}-{t.repeat}.csv", "", _whole(rows))


def across(folder: Path) -> None:
    """MATLAB arrays with samples along columns, each in a file of its own."""
    for t in TRIALS:
        name = f"{t.texture} {t.speed_mm_s} mmps run {t.repeat}.mat"
        savemat(folder / name, {"skin": t.counts.T, "fs": 1000.0})


def archives(folder: Path) -> None:
    """NumPy archives with two arrays."""
    for t in TRIALS:
        name = f"20240131_{t.texture}_{t.speed_mm_s}mmps_{t.repeat}.npz"
        np.savez(folder / name, stamps=1e6 + TIME_MS, taxels=t.counts)


LAYOUTS: tuple[Callable[[Path], None], ...] = (
    labels_in_names,
    folder_tree,
    trial_column,
    decimal_commas,
    structures,
    structures_73,
    cells,
    without_header,
    across,
    archives,
)
