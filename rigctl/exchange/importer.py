"""Import of recordings as a session: their trials, each texture a part."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl import __version__
from rigctl.config.resources import source_commit
from rigctl.config.rig_config import MAX_TAXELS, RigConfig
from rigctl.errors import DiskFault, WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.exchange.file_readers import RecordingReader
from rigctl.exchange.inspection import (
    MAX_COUNT,
    InspectedTrial,
    Inspection,
    TaxelScaling,
    extract_series,
    inspect_files,
)
from rigctl.exchange.nwb import is_simulated
from rigctl.exchange.resampling import Floats, ResampledSeries, TimeSeries, resample
from rigctl.session.header import IMPORTED, SessionHeader
from rigctl.session.recorder import Recorder
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.session_reader import highest_number
from rigctl.session.writer import RESUME
from rigctl.values import (
    SAMPLE_RATE_HZ,
    Block,
    DrumState,
    Event,
    Gap,
    LoadcellSample,
    PlannedTrial,
    TrialRow,
    Verdict,
)

FILE = "extra.h5"
DOC = (
    "row i belongs to the session's i-th sample over all parts; NaN where the file had no value; "
    "columns in the order of the attribute names"
)


class ExtraChannels:
    """Writer of ``extra.h5`` beside the session, a no-op without channels."""

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._file: Any = None
        if names:
            self._file = h5py.File(folder / FILE, "x")
            self._file.attrs["doc"] = DOC
            self._file.attrs["names"] = list(names)

    def append(self, rows: Floats) -> None:
        """Append the rows of one trial, float64 (n, channels)."""
        if self._file is None:
            return
        width = rows.shape[1]
        if "values" not in self._file:
            self._file.create_dataset(
                "values", (0, width), "f8", maxshape=(None, width), chunks=(4096, width)
            )
        values = self._file["values"]
        start = values.shape[0]
        values.resize(start + len(rows), axis=0)
        values[start:] = rows

    def __enter__(self) -> ExtraChannels:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()


MAP_FILE = "import.toml"
BLOCK_ROWS = 50_000
POLL_S = 0.1
GAP_REASON = "missing in the file"


def import_files(
    paths: Sequence[Path],
    mapping: ImportMap,
    folder: Path,
    start_utc: str,
    on_progress: Callable[[str, int], None] = lambda stage, done: None,
    is_cancelled: Callable[[], bool] = lambda: False,
) -> tuple[Inspection, bool]:
    """Inspect all files, then write them; return the inspection, and False if cancelled.

    Raises WrongUse before anything is written, SessionError and DiskFault.
    """
    if not paths:
        raise WrongUse("there is no file to import: name at least one")
    if highest_number(folder):
        raise WrongUse(f"{folder} already holds a session: name a new folder with --out")
    inspection = inspect_files(paths, mapping, lambda done: on_progress("inspecting", done))
    n_taxels = len(inspection.scaling.names)
    if n_taxels > MAX_TAXELS:
        raise WrongUse(f"{n_taxels} taxels are mapped, but a session has at most {MAX_TAXELS}")
    trials = [
        trial.label.trial(number, trial.count) for number, trial in enumerate(inspection.trials, 1)
    ]
    layout = _layout(mapping, n_taxels)
    header = replace(
        _header(mapping, inspection.scaling, trials, start_utc),
        sensor_layout=layout,
        simulated=any(map(is_simulated, paths)),
    )
    config = _config(mapping, layout)
    with Recorder(folder, header, "", config.to_toml()) as recorder:
        (folder / MAP_FILE).write_text(mapping.text, encoding="utf-8")
        with ExtraChannels(folder, mapping.extra) as extra:
            writer = _SessionWriter(recorder, mapping, inspection, extra)
            for done, (source, trial) in enumerate(zip(inspection.trials, trials, strict=True)):
                on_progress("writing", done)
                if is_cancelled():
                    return inspection, False
                writer.write(source, trial)
            writer.check()
    return inspection, True


def _header(
    mapping: ImportMap, scaling: TaxelScaling, trials: Sequence[PlannedTrial], start_utc: str
) -> SessionHeader:
    text = "\n".join(f"{trial!r}, mount {trial.mount}" for trial in trials)
    return SessionHeader(
        plan_hash=hashlib.sha256(text.encode()).hexdigest()[:32],
        seed=0,
        trials_planned=len(trials),
        rig=IMPORTED,
        simulated=False,
        start_utc=start_utc,
        protocol=mapping.name,
        sensor=mapping.sensor,
        software_version=__version__,
        software_commit=source_commit(),
        n_taxels=len(scaling.names),
        sample_unit=scaling.unit(mapping.unit),
        highest_reading=MAX_COUNT,
    )


def _layout(mapping: ImportMap, n_taxels: int) -> SensorLayout:
    """Return the map's layout of the sensor, or the default of this number of taxels."""
    layout = mapping.sensor_layout or SensorLayout.default(n_taxels)
    if layout.n_taxels != n_taxels:
        raise WrongUse(
            f"the map's [sensor] has {layout.describe()}, which are {layout.n_taxels}, but "
            f"[taxels] columns are {n_taxels}: correct one of them"
        )
    return layout


def _config(mapping: ImportMap, layout: SensorLayout) -> RigConfig:
    config = RigConfig()
    taxels = replace(
        config.taxels,
        count=layout.n_taxels,
        rows=layout.rows,
        columns=layout.columns,
        layers=layout.layers,
    )
    about = replace(config.about, name=mapping.name, sensor=mapping.sensor)
    return replace(config, about=about, taxels=taxels)


class _SessionWriter:
    """Writes the trials of a session whose clock is its sample counter."""

    def __init__(
        self, recorder: Recorder, mapping: ImportMap, inspection: Inspection, extra: ExtraChannels
    ) -> None:
        self._recorder = recorder
        self._mapping = mapping
        self._inspection = inspection
        self._extra = extra
        self._reader = RecordingReader(mapping)
        self._n_taxels = len(inspection.scaling.names)
        self._counter = 0
        self._texture: str | None = None
        self._conversions = 0

    def write(self, source: InspectedTrial, trial: PlannedTrial) -> None:
        """Write one trial's samples, load cell, extra channels, trial row and origin."""
        if source.label.texture != self._texture:
            self._begin_part(source.label.texture)
        table = self._reader.read(source.path).trials[source.index]
        series, _ = extract_series(table, self._mapping)
        resampled, _ = resample(series, self._mapping.max_gap_s, self._mapping.low_pass_hz)
        first = self._counter
        for block in self._blocks(resampled):
            self._recorder.add_block(block)
            self.check()
        self._counter += resampled.count
        self._extra.append(resampled.values[:, self._n_taxels + bool(self._mapping.loadcell) :])
        force_g = self._write_loadcell(series, trial, first, resampled.count)
        self._recorder.commit_trial(_trial_row(trial, first, resampled.count, force_g))
        self._add_event(
            "trial",
            f"trial {trial.trial_id} is {source.name}",
            rows=source.rows,
            rate_hz=round(source.rate_hz, 4),
            sha256=source.sha256,
        )

    def check(self) -> None:
        """Wait while the disk is behind. Raises DiskFault."""
        if self._recorder.status.queue_samples > BLOCK_ROWS:
            self._recorder.wait_written()
        failure = self._recorder.status.failure
        if failure is not None:
            raise DiskFault(failure.replace(RESUME, "import into another new folder"))

    def _begin_part(self, texture: str) -> None:
        self._recorder.begin_part("import", texture)
        if self._texture is None:
            self._add_import_events()
        self._texture = texture

    def _add_import_events(self) -> None:
        """Add the scaling of each taxel and every remark as events."""
        scaling, unit = self._inspection.scaling, self._mapping.unit
        for taxel, name in enumerate(scaling.names):
            offset, scale = float(scaling.offset[taxel]), float(scaling.scale[taxel])
            text = f"{name} = {offset:.9g} + {scale:.9g} × stored {unit}".strip()
            self._add_event("scaling", text, taxel=taxel, name=name, offset=offset, scale=scale)
        for remark in self._inspection.remarks:
            self._add_event("import", remark)

    def _add_event(self, kind: str, text: str, **data: Any) -> None:
        self._recorder.add_event(Event(self._counter / SAMPLE_RATE_HZ, kind, text, data))

    def _blocks(self, resampled: ResampledSeries) -> Iterator[Block]:
        counts = self._inspection.scaling.encode(resampled.values[:, : self._n_taxels])
        missing = np.diff(resampled.index, prepend=-1) - 1
        for start in range(0, len(counts), BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            counters, lost = self._counter + resampled.index[rows], missing[rows]
            gaps = tuple(
                Gap(int(counters[k] - lost[k]), int(lost[k]), GAP_REASON)
                for k in np.flatnonzero(lost)
            )
            zeros = np.zeros(len(counters), np.uint8)
            end_s = (int(counters[-1]) + 1) / SAMPLE_RATE_HZ
            yield Block(counters, counts[rows], zeros, zeros, gaps, end_s)

    def _write_loadcell(
        self, series: TimeSeries, trial: PlannedTrial, first: int, count: int
    ) -> float:
        """Write the load cell at its own rows, in polls; return its mean, NaN without one."""
        if not self._mapping.loadcell:
            return float("nan")
        force_g = series.values[:, self._n_taxels] * self._mapping.loadcell_factor
        finite = np.isfinite(force_g)
        time_us = np.rint((series.time_s + first / SAMPLE_RATE_HZ) * 1e6).astype(np.int64)
        time_us, force_g = time_us[finite], force_g[finite]
        polls_s = np.append(np.arange(0, (count - 1) / SAMPLE_RATE_HZ, POLL_S), (count - 1) / 1e3)
        start_us = first * 1000
        ends = np.searchsorted(time_us, start_us + np.rint(polls_s * 1e6), "right")
        for poll_s, start, stop in zip(polls_s, np.append(0, ends), ends, strict=False):
            samples = self._loadcell_samples(time_us[start:stop], force_g[start:stop])
            at_s = first / SAMPLE_RATE_HZ + float(poll_s)
            state = _drum_state(at_s, trial, start_us, samples)
            self._recorder.add_drum(state, trial.force_g, trial.speed_mm_s)
        return float(force_g.mean()) if len(force_g) else float("nan")

    def _loadcell_samples(self, time_us: Any, force_g: Floats) -> tuple[LoadcellSample, ...]:
        first = self._conversions + 1
        self._conversions += len(force_g)
        return tuple(
            LoadcellSample(number, int(at_us), 0, float(force))
            for number, (at_us, force) in enumerate(zip(time_us, force_g, strict=True), first)
        )


def _trial_row(trial: PlannedTrial, first: int, count: int, force_g: float) -> TrialRow:
    return TrialRow(
        trial=trial,
        attempt=1,
        part=0,
        first_counter=first,
        first_sample=-1,
        count=count,
        verdict=Verdict.COMMITTED,
        reasons=(),
        started_s=first / SAMPLE_RATE_HZ,
        ended_s=(first + count - 1) / SAMPLE_RATE_HZ,
        mean_speed_mm_s=float("nan"),
        mean_force_g=force_g,
    )


def _drum_state(
    at_s: float, trial: PlannedTrial, start_us: int, samples: tuple[LoadcellSample, ...]
) -> DrumState:
    return DrumState(
        at_s=at_s,
        board_time_us=round(at_s * 1e6),
        state=0,
        fault=0,
        fault_bits=0,
        steps=0,
        angle_deg=0.0,
        speed_mm_s=trial.speed_mm_s,
        force_g=samples[-1].force_g if samples else float("nan"),
        actuator_position_um=0,
        actuator_drive_permille=0,
        sync_count=trial.trial_id,
        sync_rise_us=start_us,
        sync_fall_us=start_us,
        index_count=0,
        status_bits=0,
        loadcell=samples,
        loadcell_lost=0,
        values={},
    )
