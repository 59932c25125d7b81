"""Inspection of all files before an import: labels, defects, and the range of each taxel."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np

from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.exchange.file_readers import DELIMITERS, RecordingReader
from rigctl.exchange.labels import (
    DEPTH,
    LEVEL,
    TrialLabel,
    number_repeats,
    parse_label,
    refuse_collisions,
)
from rigctl.exchange.recording_files import common_folder, refuse_unreadable_names
from rigctl.exchange.recording_tables import TrialTable, bounded, format_names, range_ends
from rigctl.exchange.resampling import (
    FEWEST_STEPS,
    Floats,
    ResampledSeries,
    TimeSeries,
    burst_rate,
    clean_time_column,
    find_marks,
    find_outliers,
    is_oversampled,
    resample,
    unwrap_clock,
)
from rigctl.values import SAMPLE_RATE_HZ

MAX_COUNT = 65535
MAX_DURATION_S = 24 * 3600.0
PLAUSIBLE_RATE_HZ = 100_000.0
"""Faster than any converter that a lab has at a skin."""
GRID_TOLERANCE_ROWS = 1e-6
MOST_LISTED = 12


@dataclass(frozen=True, slots=True)
class InspectedTrial:
    """One trial with its label: number ``index`` from 0 of the trials of its file.

    ``name`` names file and trial; ``count``: samples of 1 ms, those in gaps included.
    """

    path: Path
    index: int
    name: str
    label: TrialLabel
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


MOST_BACK_SHARE = 0.1
"""A clock that is set, or a glitch, costs a few rows; more of them are other trials."""


@dataclass(frozen=True, slots=True)
class Inspection:
    """All trials in their order, the scaling of taxels, and remarks on defects."""

    trials: tuple[InspectedTrial, ...]
    scaling: TaxelScaling
    remarks: tuple[str, ...]


def extract_series(table: TrialTable, mapping: ImportMap) -> tuple[TimeSeries, list[str]]:
    """Return one trial's taxels, load cell and extra channels, in this order, and remarks.

    A value beyond 10¹⁰⁰ counts as missing, as do the map's marks. Raises WrongUse for times that no
    trial has.
    """
    taxels = table.indices(mapping.taxels)
    loadcell = table.indices([mapping.loadcell] if mapping.loadcell else [])
    values = bounded(table.values[:, taxels + loadcell + table.indices(mapping.extra)])
    values[np.isin(values, mapping.missing)] = np.nan
    if mapping.time_column:
        times = table.values[:, table.indices([mapping.time_column])[0]]
        times, n_overflows = unwrap_clock(bounded(times))
        time_s = times * mapping.time_s
        _refuse_several_trials(time_s, table)
        _refuse_bursts(time_s, table, mapping)
    else:
        time_s, n_overflows = np.arange(len(values)) / mapping.rate_hz, 0
    series, remarks = clean_time_column(time_s, values, table.row_numbers, len(taxels))
    if n_overflows:
        remarks.append(f"its clock begins again at 2³² {n_overflows} times: continued")
    remarks += _index_remarks(table, taxels)
    _refuse_impossible_times(series, table.place)
    return series, remarks


def _index_remarks(table: TrialTable, taxels: Sequence[int]) -> list[str]:
    """Return a remark on a first column without a name that counts the rows and is a taxel."""
    steps = np.diff(bounded(table.values[:, 0]))
    is_index = len(steps) >= FEWEST_STEPS and bool((steps == 1).all())
    if 0 not in taxels or table.names[0] not in ("index", "1") or not is_index:
        return []
    return ["column 1 counts the rows, so it is no taxel: leave it out of columns in [taxels]"]


def _refuse_bursts(time_s: Floats, table: TrialTable, mapping: ImportMap) -> None:
    """Raise WrongUse for times of arrival, which leave a few samples of many rows.

    A map that says how long a gap is has looked at them.
    """
    if mapping.max_gap_s or not (rate_hz := burst_rate(time_s)):
        return
    raise WrongUse(
        f"{table.place}: its {len(time_s)} rows come in bursts or share a time stamp, "
        f"{rate_hz:.4g} rows a second on average: give rate_hz = {rate_hz:.4g} in [time] in place "
        "of the column, or max_gap_s in [quality] to keep these times"
    )


def _refuse_impossible_times(series: TimeSeries, place: str) -> None:
    """Raise WrongUse for times of no trial: fewer than two, of days, or of rows in nanoseconds."""
    if not len(series.time_s):
        raise WrongUse(f"{place}: fewer than two rows have different times")
    if series.time_s[-1] > MAX_DURATION_S:
        raise WrongUse(f"{place}: its times span {series.time_s[-1]:.6g} s: check unit in [time]")
    if series.period_s * PLAUSIBLE_RATE_HZ < 1 - GRID_TOLERANCE_ROWS:
        raise WrongUse(
            f"{place}: its rows are {series.period_s:.2g} s apart, which is more than "
            f"{PLAUSIBLE_RATE_HZ:,.0f} a second: check unit in [time], for "
            f"{len(series.time_s)} rows span {series.time_s[-1]:.6g} s (days, as of MATLAB's "
            "datenum, are 'd')"
        )


def _refuse_several_trials(time_s: Floats, table: TrialTable) -> None:
    """Raise WrongUse where time begins anew: of each trial but the longest, rows would be lost."""
    back = time_s < np.fmax.accumulate(time_s)
    if np.count_nonzero(back) > MOST_BACK_SHARE * len(back):
        row = table.row_numbers[np.argmax(back)]
        raise WrongUse(
            f"{table.place}: time runs backwards before {np.sum(back)} of {len(back)} rows, first "
            f"row {row}: if it holds several trials, name the column that counts them in [trials]"
        )


def inspect_files(
    paths: Sequence[Path], mapping: ImportMap, on_progress: Callable[[int], None]
) -> Inspection:
    """Inspect every trial of every file. Raises WrongUse for the first that cannot be imported."""
    refuse_unreadable_names(paths)
    inspector = _Inspector(mapping, common_folder(paths))
    for done, path in enumerate(paths):
        on_progress(done)
        inspector.inspect(path)
    if not inspector.trials:
        raise WrongUse(f"{paths[0]} has no trial with this map: every element is empty")
    labels = number_repeats(trial.label for trial in inspector.trials)
    refuse_collisions(labels, [trial.name for trial in inspector.trials])
    trials = [
        replace(trial, label=label) for trial, label in zip(inspector.trials, labels, strict=True)
    ]
    fields = ("texture", "force_g", "speed_mm_s", "direction", "mount", "repeat")
    trials.sort(key=attrgetter(*(f"label.{name}" for name in fields)))
    scaling = inspector.scaling()
    remarks = (*inspector.remarks, *_rate_remarks(trials, mapping), *_force_remarks(mapping))
    return Inspection(tuple(trials), scaling, remarks)


class _Inspector:
    """Collects each trial's properties, and the range of taxels over all files."""

    def __init__(self, mapping: ImportMap, folder: Path) -> None:
        self._folder = folder
        self.trials: list[InspectedTrial] = []
        self.remarks: list[str] = []
        self._mapping = mapping
        self._reader = RecordingReader(mapping)
        self._first: TrialTable | None = None
        self._names: tuple[str, ...] = ()
        self._low = self._high = np.empty(0)
        self._integers_at_1_khz = True

    def inspect(self, path: Path) -> None:
        """Read one file and add its trials."""
        content = self._reader.read(path)
        with open_file(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        self.remarks += [f"{self._name(path)}: {remark}" for remark in content.remarks]
        for index, table in enumerate(content.trials):
            self._inspect_trial(index, table, digest)

    def _inspect_trial(self, index: int, table: TrialTable, digest: str) -> None:
        label = parse_label(table.path, self._mapping.labels, table.labels, table.place)
        self._check_layout(table)
        series, remarks = extract_series(table, self._mapping)
        remarks += self._outlier_remarks(series) + self._mark_remarks(series)
        resampled, gaps = resample(series, self._mapping.max_gap_s, self._mapping.low_pass_hz)
        remarks += [f"gap from {start:.3f} to {end:.3f} s" for start, end in gaps]
        name = f"{self._name(table.path)}{table.place.removeprefix(str(table.path))}"
        self.remarks += [f"{name}: {remark}" for remark in remarks]
        self._extend_range(series, resampled)
        rows, rate_hz, count = len(series.time_s), series.rate_hz, resampled.count
        self.trials.append(
            InspectedTrial(table.path, index, name, label, rows, rate_hz, count, digest)
        )

    def _name(self, path: Path) -> str:
        return path.absolute().relative_to(self._folder).as_posix()

    def _check_layout(self, table: TrialTable) -> None:
        """Raise WrongUse for a table of another layout than the first."""
        names = tuple(table.names[k] for k in table.indices(self._mapping.taxels))
        first, self._first = self._first, self._first or table
        if first is None:
            self._names = names
        elif len(names) != len(self._names):
            raise WrongUse(
                f"{table.place} has {len(names)} taxels, but the files before it have "
                f"{len(self._names)}: import them into separate sessions"
            )
        elif _are_two_layouts(first, table, self._mapping):
            raise WrongUse(
                f"{table.place} has the columns {format_names(table.names)}, but {first.path.name} "
                f"has {format_names(first.names)}: import each layout with a map of its own"
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
        scale = (self._high - self._low) / MAX_COUNT
        return TaxelScaling(self._names, self._low, np.where(scale > 0, scale, 1.0))

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
        shown = [f"{self._names[column]} {count}" for column, count, _ in found[:MOST_LISTED]]
        listed = ", ".join(shown) + (
            f", … ({len(found)} taxels)" if len(found) > len(shown) else ""
        )
        first_s = series.time_s[min(row for *_, row in found)]
        return [f"outliers from {first_s:.3f} s on, kept: {listed}"]

    def _mark_remarks(self, series: TimeSeries) -> list[str]:
        """Return a remark for each number that taxels repeat far from all their other values."""
        found: Counter[float] = Counter()
        for column in range(len(self._names)):
            found.update(find_marks(series.values[:, column]))
        return [
            f"{mark:g} stands {count} times, far from all other values of its taxels: if it says "
            f"that a value is missing, give missing = [{mark:g}] in [files]"
            for mark, count in found.items()
        ]

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


def _are_two_layouts(first: TrialTable, table: TrialTable, mapping: ImportMap) -> bool:
    """Return whether the map's numbers count columns that two text tables name differently."""
    ends = {end for item in mapping.channels for end in range_ends(item)}
    by_name = ends <= set(table.names) & set(first.names)
    is_text = {first.path.suffix.lower(), table.path.suffix.lower()} <= DELIMITERS.keys()
    return is_text and not by_name and table.names != first.names


def _rate_remarks(trials: Sequence[InspectedTrial], mapping: ImportMap) -> list[str]:
    """Return remarks on rates that are too low for the texture, or higher than 1 kHz."""
    slow: dict[float, list[float]] = defaultdict(list)
    for trial in trials:
        if trial.rate_hz * mapping.finest_mm < 2 * trial.label.speed_mm_s:
            slow[trial.label.speed_mm_s].append(trial.rate_hz)
    remarks = [
        f"sampled too slowly in {len(rates)} trials at {speed:g} mm/s: {min(rates):.1f} Hz shows "
        f"nothing finer than {2 * speed / min(rates):.2g} mm, {mapping.finest_mm:g} mm need "
        f"{2 * speed / mapping.finest_mm:.0f} Hz"
        for speed, rates in sorted(slow.items())
    ]
    if n_fast := sum(is_oversampled(trial.rate_hz) for trial in trials):
        low_pass = f"behind a low-pass of {mapping.low_pass_hz:g} Hz"
        filtered = low_pass if mapping.low_pass_hz else "without a filter, as the map says"
        fast = f"{n_fast} trials have more than {SAMPLE_RATE_HZ} rows a second"
        remarks.append(f"{fast}: taken at 1 kHz {filtered}")
    return remarks


def _force_remarks(mapping: ImportMap) -> list[str]:
    """Return a remark on labels that stand in the place of forces."""
    if not mapping.labels.names_force:
        return []
    unit = mapping.labels.force.unit
    if unit == LEVEL:
        return ["forces are levels without a unit, in the place of grams"]
    return ["depths in mm stand in the place of grams"] if unit == DEPTH else []
