"""NWB files (schema 2) read as variables of trials: the series of each, and its row of the table.

``trials.2.taxels`` is the series ``taxels`` of the second trial, ``trials.2.texture`` the text that
the table of trials has for it, ``trials.2.time`` the time of each of its samples in seconds. A file
without a table of trials is one trial, whose names have nothing before them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.exchange.matlab import member
from rigctl.exchange.recording_tables import MAX_FILE_TRIALS
from rigctl.session.hdf5_file import HDF5_ERRORS, NUMBERS, describe

Floats = NDArray[np.float64]
SUFFIX = ".nwb"
TRIALS, TIME = "trials", "time"
HALF_SAMPLE = 0.5


class _Series(NamedTuple):
    """One time series: ``data`` (n,) or (n, m) as stored, ``times_s`` float64 (n,)."""

    name: str
    data: NDArray[Any]
    times_s: Floats


def read_nwb(path: Path) -> dict[str, Any]:
    """Return the acquired series and the labels of every trial by name, numbers as they are stored.

    The series with the most samples gives the times; one on another clock has each of its samples
    beside the nearest of these, and NaN between. Raises WrongUse for a damaged file and for one
    without a series.
    """
    try:
        with h5py.File(path, "r") as file:
            series = sorted(_acquired(file), key=_fastest_first)
            rows = _trial_rows(file)
    except HDF5_ERRORS as error:
        raise WrongUse(f"{path} is not an NWB file, or is damaged: {describe(error)}") from error
    if not series:
        raise WrongUse(f"{path} has no time series with numbers among its acquisitions")
    if len(rows) > MAX_FILE_TRIALS:
        raise WrongUse(f"{path} has {len(rows):,} trials; {MAX_FILE_TRIALS:,} at most")
    times_s = series[0].times_s
    columns = {TIME: times_s} | {one.name: _beside(one, times_s) for one in series}
    if not rows:
        return columns
    early_s = HALF_SAMPLE * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    return {
        f"{TRIALS}.{number}.{name}": value
        for number, labels in enumerate(rows, 1)
        for name, value in {**_cut(columns, labels, early_s), **labels}.items()
    }


def is_simulated(path: Path) -> bool:
    """Return whether a file is one of NWB whose keywords say that its data are simulated."""
    if path.suffix.lower() != SUFFIX:
        return False
    with h5py.File(path, "r") as file:
        return b"simulated" in file.get("general/keywords", np.empty(0, object))[()]


def _cut(
    columns: Mapping[str, NDArray[Any]], labels: Mapping[str, Any], early_s: float
) -> dict[str, NDArray[Any]]:
    """Return the samples from a trial's start to before its stop."""
    ends_s = np.array([float(labels["start_time"]), float(labels["stop_time"])]) - early_s
    first, end = np.searchsorted(columns[TIME], ends_s)
    return {name: values[first:end] for name, values in columns.items()}


def _beside(series: _Series, times_s: Floats) -> NDArray[Any]:
    """Return a series' values at the times nearest to its own, NaN at all others."""
    if len(series.times_s) == len(times_s) and np.allclose(series.times_s, times_s, 0, 1e-9):
        return series.data
    middles_s = (times_s[1:] + times_s[:-1]) / 2
    values = np.full((len(times_s), *series.data.shape[1:]), np.nan)
    values[np.searchsorted(middles_s, series.times_s)] = series.data
    return values


def _fastest_first(series: _Series) -> int:
    return -len(series.times_s)


def _acquired(file: h5py.File) -> Iterator[_Series]:
    """Yield the series of numbers."""
    group = member(file, "acquisition")
    for name in group:
        node = member(group, name)
        if not isinstance(node, h5py.Group) or "data" not in node:
            continue
        data = member(node, "data")
        if data.ndim in (1, 2) and data.dtype.kind in NUMBERS:
            yield _Series(name, data[()], _times_s(node, len(data)))


def _times_s(node: h5py.Group, n_samples: int) -> Floats:
    """Return the time of each sample, from its time stamps or from start and rate."""
    if "timestamps" in node:
        # A series may have the time stamps of another one by a link inside the file.
        if isinstance(node.get("timestamps", getlink=True), h5py.ExternalLink):
            raise ValueError(f"{node.name}/timestamps are in another file")
        return np.asarray(node["timestamps"][()], np.float64)
    start = member(node, "starting_time")
    return float(start[()]) + np.arange(n_samples) / float(start.attrs["rate"])


def _trial_rows(file: h5py.File) -> list[dict[str, Any]]:
    """Return each trial's row of the table of trials: numbers and texts by column."""
    if TRIALS not in file.get("intervals", ()):
        return []
    table = member(member(file, "intervals"), TRIALS)
    columns = {name: member(table, name) for name in table.attrs["colnames"]}
    plain = {
        name: column.asstr()[()] if h5py.check_string_dtype(column.dtype) else column[()]
        for name, column in columns.items()
        if column.ndim == 1 and f"{name}_index" not in table
    }
    n_trials = len(plain["start_time"])
    return [{name: values[row] for name, values in plain.items()} for row in range(n_trials)]
