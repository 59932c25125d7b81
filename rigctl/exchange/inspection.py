"""Inspection of all files before an import: labels, defects, and the range of each taxel."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np

from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse
from rigctl.exchange.column_map import FileLabel, ImportMap, number_repeats, parse_label
from rigctl.exchange.file_readers import FileColumns, read_columns
from rigctl.exchange.resampling import (
    Floats,
    ResampledSeries,
    TimeSeries,
    clean_time_column,
    find_outliers,
    is_oversampled,
    resample,
)
from rigctl.values import SAMPLE_RATE_HZ

MAX_COUNT = 65535
MAX_DURATION_S = 24 * 3600.0
GRID_TOLERANCE_ROWS = 1e-6


@dataclass(frozen=True, slots=True)
class InspectedFile:
    """One file with its label; ``count``: samples of 1 ms in its trial, gaps included."""

    path: Path
    label: FileLabel
    rows: int
    rate_hz: float
    count: int
    sha256: str


@dataclass(frozen=True, slots=True)
class TaxelScaling:
    """The conversion of stored counts to values of the files: ``offset + scale × count``.

    ``fixed``: the range is the map's own, not that of the files.
    """

    names: tuple[str, ...]
    offset: Floats
    scale: Floats
    fixed: bool = False

    def unit(self, unit: str) -> str:
        """Return the unit of a stored reading; ``unit``: that of the values in the files."""
        if np.all(self.offset == 0) and np.all(self.scale == 1):
            return f"{unit or 'as in the files'}, 0–{MAX_COUNT}"
        ends = "each taxel's lowest to its highest value"
        if self.fixed:
            ends = "the map's low to its high"
        values = unit or "the values of the files"
        return f"0–{MAX_COUNT} from {ends}; scaling events turn it into {values}"

    def encode(self, values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
        """Return the stored counts of values (n, taxels), uint16."""
        counts = np.rint((values - self.offset) / self.scale)
        return np.clip(counts, 0, MAX_COUNT).astype(np.uint16)


@dataclass(frozen=True, slots=True)
class Inspection:
    """All files in the order of their trials, the scaling of taxels, and remarks on defects."""

    files: tuple[InspectedFile, ...]
    scaling: TaxelScaling
    remarks: tuple[str, ...]


def extract_series(columns: FileColumns, mapping: ImportMap) -> tuple[TimeSeries, list[str]]:
    """Return one file's taxels, load cell and extra channels, in this order, and remarks."""
    taxels = columns.indices(mapping.taxels)
    loadcell = columns.indices([mapping.loadcell] if mapping.loadcell else [])
    values = columns.values[:, taxels + loadcell + columns.indices(mapping.extra)]
    if mapping.time_column:
        time_s = columns.values[:, columns.indices([mapping.time_column])[0]] * mapping.time_s
    else:
        time_s = np.arange(len(values)) / mapping.rate_hz
    series, remarks = clean_time_column(time_s, values, columns.first_row, len(taxels))
    if not len(series.time_s):
        raise WrongUse(f"{columns.path}: fewer than two rows have different times")
    if series.time_s[-1] > MAX_DURATION_S:
        raise WrongUse(
            f"{columns.path}: its times span {series.time_s[-1]:.0f} s: check unit in [time]"
        )
    if columns.truncated:
        remarks.append("its last row is incomplete: left out")
    return series, remarks


def inspect_files(
    paths: Sequence[Path], mapping: ImportMap, on_progress: Callable[[int], None]
) -> Inspection:
    """Inspect every file. Raises WrongUse for the first one that cannot be imported."""
    inspector = _Inspector(mapping)
    for done, path in enumerate(paths):
        on_progress(done)
        inspector.inspect(path)
    labels = number_repeats(file.label for file in inspector.files)
    files = [
        replace(file, label=label) for file, label in zip(inspector.files, labels, strict=True)
    ]
    fields = ("texture", "force_g", "speed_mm_s", "direction", "repeat")
    files.sort(key=attrgetter(*(f"label.{name}" for name in fields)))
    scaling = inspector.scaling()
    remarks = (*inspector.remarks, *_rate_remarks(files, mapping))
    return Inspection(tuple(files), scaling, remarks)


class _Inspector:
    """Collects each file's properties, and the range of taxels over all files."""

    def __init__(self, mapping: ImportMap) -> None:
        self.files: list[InspectedFile] = []
        self.remarks: list[str] = []
        self._mapping = mapping
        self._names: tuple[str, ...] = ()
        self._low = self._high = np.empty(0)
        self._integers_at_1_khz = True

    def inspect(self, path: Path) -> None:
        """Read one file and add its properties."""
        label = parse_label(path, self._mapping)
        columns = read_columns(path, self._mapping)
        names = tuple(columns.names[k] for k in columns.indices(self._mapping.taxels))
        if self._names and len(names) != len(self._names):
            raise WrongUse(
                f"{path} has {len(names)} taxels, but the files before it have {len(self._names)}: "
                "import them into separate sessions"
            )
        self._names = self._names or names
        series, remarks = extract_series(columns, self._mapping)
        remarks += self._outlier_remarks(series)
        resampled, gaps = resample(series, self._mapping.max_gap_s, self._mapping.low_pass_hz)
        remarks += [f"gap from {start:.3f} to {end:.3f} s" for start, end in gaps]
        self.remarks += [f"{path.name}: {remark}" for remark in remarks]
        self._extend_range(series, resampled)
        with open_file(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        n_rows = len(series.time_s)
        self.files.append(
            InspectedFile(path, label, n_rows, series.rate_hz, resampled.count, digest)
        )

    def scaling(self) -> TaxelScaling:
        """Return the scaling: integers at 1 kHz stay unchanged, all else spans the full range."""
        low, high = self._mapping.taxel_low, self._mapping.taxel_high
        if low < high:
            return self._fixed_scaling(low, high)
        fits = self._low.min() >= 0 and self._high.max() <= MAX_COUNT
        if self._integers_at_1_khz and fits:
            return TaxelScaling(self._names, np.zeros(len(self._names)), np.ones(len(self._names)))
        for name in np.array(self._names)[self._high == self._low]:
            self.remarks.append(f"{name} never changes")
        span = self._high - self._low
        return TaxelScaling(self._names, self._low, np.where(span > 0, span / MAX_COUNT, 1.0))

    def _fixed_scaling(self, low: float, high: float) -> TaxelScaling:
        """Return the map's own range, which is the same for every import with that map."""
        outside = (self._low < low) | (self._high > high)
        for name in np.array(self._names)[outside]:
            self.remarks.append(f"{name} leaves the range {low:g} to {high:g}: clipped")
        n = len(self._names)
        scale = np.full(n, (high - low) / MAX_COUNT)
        return TaxelScaling(self._names, np.full(n, low), scale, fixed=True)

    def _outlier_remarks(self, series: TimeSeries) -> list[str]:
        taxels = TimeSeries(series.time_s, series.values[:, : len(self._names)])
        found = find_outliers(taxels, self._mapping.outlier_sigma)
        if not found:
            return []
        listed = ", ".join(f"{self._names[column]} {count}" for column, count, _ in found)
        first_s = series.time_s[min(row for *_, row in found)]
        return [f"outliers from {first_s:.3f} s on, kept: {listed}"]

    def _extend_range(self, series: TimeSeries, resampled: ResampledSeries) -> None:
        # A filter may overshoot the range of its input.
        source = resampled.values if is_oversampled(series.rate_hz) else series.values
        values = source[:, : len(self._names)]
        low, high = values.min(axis=0), values.max(axis=0)
        self._low = np.minimum(self._low, low) if self._low.size else low
        self._high = np.maximum(self._high, high) if self._high.size else high
        rows = series.time_s * SAMPLE_RATE_HZ
        on_grid = bool(np.all(np.abs(rows - np.arange(len(rows))) < GRID_TOLERANCE_ROWS))
        integers = bool(np.all(values == np.rint(values)))
        self._integers_at_1_khz = self._integers_at_1_khz and on_grid and integers


def _rate_remarks(files: Sequence[InspectedFile], mapping: ImportMap) -> list[str]:
    """Return remarks on rates that are too low for the texture, or higher than 1 kHz."""
    slow: dict[float, list[float]] = defaultdict(list)
    for file in files:
        if file.rate_hz * mapping.finest_mm < 2 * file.label.speed_mm_s:
            slow[file.label.speed_mm_s].append(file.rate_hz)
    remarks = [
        f"sampled too slowly in {len(rates)} files at {speed:g} mm/s: {min(rates):.1f} Hz shows "
        f"nothing finer than {2 * speed / min(rates):.2g} mm, {mapping.finest_mm:g} mm need "
        f"{2 * speed / mapping.finest_mm:.0f} Hz"
        for speed, rates in sorted(slow.items())
    ]
    if n_fast := sum(is_oversampled(file.rate_hz) for file in files):
        low_pass = f"behind a low-pass of {mapping.low_pass_hz:g} Hz"
        filtered = low_pass if mapping.low_pass_hz else "without a filter, as the map says"
        fast = f"{n_fast} files have more than {SAMPLE_RATE_HZ} rows a second"
        remarks.append(f"{fast}: taken at 1 kHz {filtered}")
    if mapping.force_unit == "level" and "force" in mapping.pattern.groupindex:
        remarks.append("forces are levels without a unit, in the place of grams")
    return remarks
