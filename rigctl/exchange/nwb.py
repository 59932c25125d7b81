"""NWB files (schema 2) read as variables of trials: the series of each, and its row of the table.

``trials.2.taxels`` is the series ``taxels`` of the second trial, ``trials.2.texture`` the text that
the table of trials has for it, ``trials.2.time`` the time of each of its samples in seconds. A file
without a table of trials is one trial, whose names have nothing before them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.exchange.matlab import member
from rigctl.exchange.recording_tables import MAX_FILE_TRIALS, Floats
from rigctl.session.hdf5_file import HDF5_ERRORS, NUMBERS, describe

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
    with _opened(path) as file:
        series = sorted(_acquired(file), key=_fastest_first)
        if not series:
            raise WrongUse(f"{path} has no time series with numbers among its acquisitions")
        times_s = series[0].times_s
        columns = {TIME: times_s} | {one.name: _beside(one, times_s) for one in series}
        rows = _trial_rows(file)
        if len(rows) > MAX_FILE_TRIALS:
            raise WrongUse(f"{path} has {len(rows):,} trials; {MAX_FILE_TRIALS:,} at most")
        early_s = HALF_SAMPLE * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
        trials = [{**_cut(columns, labels, early_s), **labels} for labels in rows]
    if not trials:
        return columns
    return {
        f"{TRIALS}.{number}.{name}": value
        for number, trial in enumerate(trials, 1)
        for name, value in trial.items()
    }


def is_simulated(path: Path) -> bool:
    """Return whether a file is one of NWB whose keywords say that its data are simulated."""
    if path.suffix.lower() != SUFFIX:
        return False
    with _opened(path) as file:
        if not _has(file, "general") or not _has(member(file, "general"), "keywords"):
            return False
        return b"simulated" in np.atleast_1d(_dataset(file, "general/keywords")[()]).tolist()


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open a file. Raises WrongUse where something in it is not as NWB has it."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except HDF5_ERRORS as error:
        raise WrongUse(f"{path} is not an NWB file, or is damaged: {describe(error)}") from error


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
    group = member(file, "acquisition") if _has(file, "acquisition") else {}
    for name in group:
        node = member(group, name)
        if not isinstance(node, h5py.Group) or not _has(node, "data"):
            continue
        data = _dataset(node, "data")
        if data.ndim in (1, 2) and data.dtype.kind in NUMBERS:
            yield _Series(name, data[()], _times_s(node, len(data)))


def _times_s(node: h5py.Group, n_samples: int) -> Floats:
    """Return the time of each sample, from its time stamps or from start and rate."""
    if not _has(node, "timestamps"):
        start = _dataset(node, "starting_time")
        numbers = [np.asarray(value) for value in (start[()], start.attrs["rate"])]
        if any(number.dtype.kind not in NUMBERS for number in numbers):
            raise ValueError(f"{start.name} or its rate is not a number")
        start_s, rate_hz = map(float, numbers)
        return start_s + np.arange(n_samples) / rate_hz
    link = node.get("timestamps", getlink=True)
    # A series may have the time stamps of another one, by a link inside the file.
    place = link.path if isinstance(link, h5py.SoftLink) else f"{node.name}/timestamps"
    stamps = _dataset(node.file, place)
    if stamps.dtype.kind not in NUMBERS or stamps.shape != (n_samples,):
        raise ValueError(f"{node.name}/timestamps are not one number for each sample")
    return np.asarray(stamps[()], np.float64)


def _trial_rows(file: h5py.File) -> list[dict[str, Any]]:
    """Return each trial's row of the table of trials: numbers and texts by column."""
    if not _has(file, "intervals") or not _has(member(file, "intervals"), TRIALS):
        return []
    table = member(member(file, "intervals"), TRIALS)
    columns = {}
    for name in table.attrs["colnames"]:
        column = _dataset(table, str(name))
        if column.ndim == 1 and not _has(table, f"{name}_index"):
            if h5py.check_string_dtype(column.dtype):
                columns[str(name)] = column.asstr(errors="replace")[()]
            elif column.dtype.kind in NUMBERS:
                columns[str(name)] = column[()]
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise ValueError("the columns of /intervals/trials have different lengths")
    return [{name: column[row] for name, column in columns.items()} for row in range(*lengths)]


def _has(group: Any, name: str) -> bool:
    """Return whether a group has a member of that name, without following a link."""
    return isinstance(group, h5py.Group) and group.get(name, getlink=True) is not None


def _dataset(group: Any, path: str) -> h5py.Dataset:
    """Return a data set of the file itself. Raises ValueError for anything else."""
    node = group
    for name in path.strip("/").split("/"):
        node = member(node, name) if isinstance(node, h5py.Group) else None
    if not isinstance(node, h5py.Dataset):
        raise ValueError(f"{group.name}/{path} is not a data set".replace("//", "/"))
    return node
