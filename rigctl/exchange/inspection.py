"""A first look at every file to be imported: whether it can be, what is wrong, its range."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.exchange.file_readers import FileColumns, read_columns
from rigctl.exchange.filename_labels import Label, label_of, numbered
from rigctl.exchange.resampling import (
    Floats,
    Resampled,
    Track,
    is_fast,
    outliers,
    resample,
    sound_track,
)
from rigctl.values import SAMPLE_RATE_HZ

COUNTS = 65535
LONGEST_S = 24 * 3600.0
ON_GRID = 1e-6


@dataclass(frozen=True, slots=True)
class InspectedFile:
    """One file: where its trial belongs and how many samples of 1 ms it makes."""

    path: Path
    label: Label
    rows: int
    rate_hz: float
    count: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Scaling:
    """How stored counts become what stood in the files: ``offset + scale × count``."""

    names: tuple[str, ...]
    offset: Floats
    scale: Floats
    given: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether what is stored is what stood in the files."""
        return bool(np.all(self.offset == 0) and np.all(self.scale == 1))

    def unit(self, named: str) -> str:
        """What a stored reading is, for the session; ``named``: the map's own unit."""
        if self.is_plain:
            return f"{named or 'as in the files'}, 0–{COUNTS}"
        ends = (
            "the map's low to its high"
            if self.given
            else "each taxel's lowest to its highest value"
        )
        return (
            f"0–{COUNTS} from {ends}; "
            f"scaling events turn it into {named or 'what stood in the files'}"
        )

    def counts(self, values: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
        """Values (n, taxels) as stored, uint16."""
        raw = np.rint((values - self.offset) / self.scale)
        return np.clip(raw, 0, COUNTS).astype(np.uint16)


@dataclass(frozen=True, slots=True)
class Inspection:
    """All files in the order in which they become trials, and what is to be said of them."""

    files: tuple[InspectedFile, ...]
    scaling: Scaling
    lines: tuple[str, ...]


def track_of(columns: FileColumns, mapping: ImportMap) -> tuple[Track, list[str]]:
    """One file's taxels, load cell and extra channels, in this order, in sound time."""
    taxels = columns.places(mapping.taxels)
    loadcell = columns.places([mapping.loadcell] if mapping.loadcell else [])
    others = loadcell + columns.places(mapping.extra)
    values = columns.values[:, taxels + others]
    if mapping.time_column:
        time_s = columns.values[:, columns.places([mapping.time_column])[0]] * mapping.time_s
    else:
        time_s = np.arange(len(values)) / mapping.rate_hz
    track, lines = sound_track(time_s, values, columns.first_row, len(taxels))
    if not len(track.time_s):
        raise WrongUse(f"{columns.path}: fewer than two rows have a time of their own")
    if track.time_s[-1] > LONGEST_S:
        raise WrongUse(
            f"{columns.path}: its times span {track.time_s[-1]:.0f} s: check unit in [time]"
        )
    if columns.cut_short:
        lines.append("its last row is cut short: left out")
    return track, lines


def inspect_files(
    paths: Sequence[Path], mapping: ImportMap, on_file: Callable[[int], None] = lambda done: None
) -> Inspection:
    """Look at every file. Raises WrongUse for the first that cannot be imported."""
    seen = _Seen(mapping)
    for done, path in enumerate(paths):
        on_file(done)
        seen.look(path)
    labels = numbered([file.label for file in seen.files])
    files = [
        InspectedFile(file.path, label, file.rows, file.rate_hz, file.count, file.sha256)
        for file, label in zip(seen.files, labels, strict=True)
    ]
    files.sort(key=lambda file: _order(file.label))
    return Inspection(tuple(files), seen.scaling(), (*seen.lines, *_rate_lines(files, mapping)))


def _order(label: Label) -> tuple[str, float, float, str, int]:
    return label.texture, label.force_g, label.speed_mm_s, label.direction, label.repeat


class _Seen:
    """What the files seen so far have in common."""

    def __init__(self, mapping: ImportMap) -> None:
        self.files: list[InspectedFile] = []
        self.lines: list[str] = []
        self._mapping = mapping
        self._names: tuple[str, ...] = ()
        self._low = self._high = np.empty(0)
        self._plain = True

    def look(self, path: Path) -> None:
        """Read one file and note what is of interest."""
        label = label_of(path, self._mapping)
        columns = read_columns(path, self._mapping)
        places = columns.places(self._mapping.taxels)
        names = tuple(columns.names[place] for place in places)
        if self._names and len(names) != len(self._names):
            raise WrongUse(
                f"{path} has {len(names)} taxels, the files before it {len(self._names)}: "
                "import them into sessions of their own"
            )
        self._names = self._names or names
        track, lines = track_of(columns, self._mapping)
        lines += self._outlier_lines(track)
        grid, gaps = resample(track, self._mapping.max_gap_s, self._mapping.low_pass_hz)
        lines += [f"gap from {start:.3f} to {end:.3f} s" for start, end in gaps]
        self.lines += [f"{path.name}: {line}" for line in lines]
        self._note_range(track, grid)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        self.files.append(
            InspectedFile(path, label, len(track.time_s), track.rate_hz, grid.count, digest)
        )

    def scaling(self) -> Scaling:
        """Whole numbers at 1 kHz stay as they are; everything else fills the range of counts."""
        low, high = self._mapping.taxel_low, self._mapping.taxel_high
        if low < high:
            return self._given(low, high)
        fits = self._low.min() >= 0 and self._high.max() <= COUNTS
        if self._plain and fits:
            return Scaling(self._names, np.zeros(len(self._names)), np.ones(len(self._names)))
        for name in np.array(self._names)[self._high == self._low]:
            self.lines.append(f"{name} never changes")
        span = self._high - self._low
        return Scaling(self._names, self._low, np.where(span > 0, span / COUNTS, 1.0))

    def _given(self, low: float, high: float) -> Scaling:
        """The map's own range, the same for every import with it."""
        outside = (self._low < low) | (self._high > high)
        for name in np.array(self._names)[outside]:
            self.lines.append(f"{name} goes beyond {low:g} to {high:g}: cut off there")
        n = len(self._names)
        return Scaling(self._names, np.full(n, low), np.full(n, (high - low) / COUNTS), given=True)

    def _outlier_lines(self, track: Track) -> list[str]:
        taxels = Track(track.time_s, track.values[:, : len(self._names)])
        found = outliers(taxels, self._mapping.outlier_sigma)
        if not found:
            return []
        where = ", ".join(f"{self._names[column]} {count}" for column, count, _ in found)
        first_s = track.time_s[min(row for *_, row in found)]
        return [f"outliers from {first_s:.3f} s on, kept: {where}"]

    def _note_range(self, track: Track, grid: Resampled) -> None:
        # What is filtered may swing past the rows that it is made of.
        source = grid.values if is_fast(track.rate_hz) else track.values
        values = source[:, : len(self._names)]
        low, high = values.min(axis=0), values.max(axis=0)
        self._low = np.minimum(self._low, low) if self._low.size else low
        self._high = np.maximum(self._high, high) if self._high.size else high
        places = track.time_s * SAMPLE_RATE_HZ
        on_grid = bool(np.all(np.abs(places - np.arange(len(places))) < ON_GRID))
        self._plain = self._plain and on_grid and bool(np.all(values == np.rint(values)))


def _rate_lines(files: Sequence[InspectedFile], mapping: ImportMap) -> list[str]:
    """Where rows come too seldom for the texture, or oftener than they are stored."""
    slow: dict[float, list[float]] = defaultdict(list)
    lines = []
    for file in files:
        if file.rate_hz * mapping.finest_mm < 2 * file.label.speed_mm_s:
            slow[file.label.speed_mm_s].append(file.rate_hz)
    for speed, rates in sorted(slow.items()):
        rate = min(rates)
        lines.append(
            f"sampled too slowly in {len(rates)} files at {speed:g} mm/s: {rate:.1f} Hz shows "
            f"nothing finer than {2 * speed / rate:.2g} mm, {mapping.finest_mm:g} mm need "
            f"{2 * speed / mapping.finest_mm:.0f} Hz"
        )
    fast = [file for file in files if is_fast(file.rate_hz)]
    if fast:
        lines.append(
            f"{len(fast)} files have more than {SAMPLE_RATE_HZ} rows a second: taken at 1 kHz "
            + (
                f"behind a low-pass of {mapping.low_pass_hz:g} Hz"
                if mapping.low_pass_hz
                else "without a filter before, as the map says"
            )
        )
    if mapping.force_unit == "level" and "force" in mapping.pattern.groupindex:
        lines.append("forces are levels without a unit: they stand where grams do")
    return lines
