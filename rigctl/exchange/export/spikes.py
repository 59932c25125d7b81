"""Spikes of a session for an export: of the drum as ``rigctl encode`` makes them, else the board's.

The drum's are encoded from rest at the start of each committed trial, the same trials with the same
ranges as those of ``rigctl encode``. They are made anew for each reading of the series, a batch of
trials at a time, so that they need no memory. The finger's are those that its board recorded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.cache import Resources
from rigctl.analysis.options import EncoderOptions
from rigctl.analysis.spike_counts import (
    PreparedTrials,
    count_conditions,
    files_of_trials,
    group_by_condition,
    prepare_trials,
)
from rigctl.analysis.trial_set import TrialRef, join_sessions, open_trials
from rigctl.encoder.batch import window_counts
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import FeatureLayout
from rigctl.errors import SessionError
from rigctl.exchange.export.content import (
    TIME,
    Block,
    Column,
    Content,
    Series,
    SpikeTrains,
    Unit,
    number_column,
)
from rigctl.exchange.export.selection import Representation
from rigctl.session.layout import COUNTER
from rigctl.session.session import Session

BATCH = 64
BOARD_SPIKES = "/taxels/spikes"
SLICE_ROWS = 1 << 18
DOC = "one row a spike"
COLUMNS = (
    number_column("unit", "u2", "", "row of the table of units, from 0"),
    number_column("counter", "i8", "samples", "the board's number of the spike's sample"),
    number_column(TIME, "f8", "s", "time of that sample since the start of the session"),
)
TRIAL = number_column("trial_id", "i4", "", "trial whose readings were encoded")


def spikes_of(content: Content, options: EncoderOptions) -> SpikeTrains | None:
    """Return the spikes of the chosen trials and taxels; None where none are wanted.

    Raises SessionError for a session without any, and WrongUse for options that do not fit it.
    """
    wanted = set(content.selection.representations) - {Representation.READINGS}
    if not wanted:
        return None
    if not isinstance(content.reader, Session):
        return _board_spikes(content)
    spikes = _EncodedSpikes.prepare(content, options)
    return SpikeTrains(
        spikes.units,
        spikes.observed_s,
        Series("spikes", DOC, (*COLUMNS, TRIAL), spikes.blocks),
        spikes.counts() if Representation.COUNTS in wanted else (),
        spikes.prepared.trials.remarks,
    )


@dataclass(frozen=True)
class _EncodedSpikes:
    """Trials to encode, in the order of time. ``rows``: the encoder's row of each of ``units``."""

    content: Content
    options: EncoderOptions
    prepared: PreparedTrials
    chosen: tuple[TrialRef, ...]
    units: tuple[Unit, ...]
    rows: NDArray[np.int64]

    @classmethod
    def prepare(cls, content: Content, options: EncoderOptions) -> _EncodedSpikes:
        """Find the trials, their ranges and the units."""
        if not len(content.attempts):
            raise SessionError(
                f"{content.reader.path} has no trials, and spikes are encoded trial by trial: "
                "export its readings alone (--representations readings)"
            )
        resources = Resources(progress=content.progress)
        parameters = options.parameters
        trials = join_sessions([content.reader.path], content.progress, parameters.reading)
        ranges, settings = options.taxel_ranges, options.analysis
        prepared = prepare_trials(trials, resources, ranges, settings)
        attempts = set(content.attempts.tolist())
        recorded = sorted(prepared.trials.trials, key=lambda trial: trial.row)
        chosen = tuple(trial for trial in recorded if trial.row in attempts)
        if not chosen:
            raise SessionError(
                f"{content.reader.path}: none of the chosen trials has spikes: choose committed "
                "trials with motion, or only the representation readings"
            )
        sensor = content.reader.sensor_layout
        n, names = sensor.n_taxels, sensor.train_names()
        own = [(name, row) for name, row in names if row % n in content.taxels]
        units = tuple(
            Unit(
                name,
                ("SA", "RA")[row // n],
                sensor.layers[sensor.layer_of(row % n)],
                row % n + 1,
                parameters.name,
            )
            for name, row in own
        )
        rows = np.array([row for _, row in own], np.int64)
        return cls(content, options, prepared, chosen, units, rows)

    @property
    def observed_s(self) -> NDArray[np.float64]:
        """Start and end of each encoded trial, float64 (n, 2)."""
        starts = self._starts_s(self.chosen)
        rate_hz = self.content.reader.header.sample_rate_hz
        lengths = np.array([trial.n_samples for trial in self.chosen])
        return np.stack([starts, starts + lengths / rate_hz], axis=1)

    def blocks(self) -> Iterator[Block]:
        """Encode a batch of trials after the other."""
        n = len(self.chosen)
        for first in range(0, n, BATCH):
            self.content.progress("encoding trials", first, n)
            yield self._encode(self.chosen[first : first + BATCH])
        self.content.progress("encoding trials", n, n)

    def counts(self) -> tuple[Series, ...]:
        """Return the spikes in the paper's windows: unscaled, and scaled by the speed."""
        layouts = dict(zip(("unscaled", "speed_scaled"), self.prepared.layouts, strict=True))
        return tuple(
            Series(
                f"counts_{name}",
                f"spikes of each unit in windows of {layout.window_ms:g} ms"
                + (f" at {layout.reference_mm_s:g} mm/s" if layout.scaled else ""),
                (TRIAL, self._count_column(layout)),
                partial(self._count_blocks, layout),
            )
            for name, layout in layouts.items()
        )

    def _count_column(self, layout: FeatureLayout) -> Column:
        parts = [f"{u.name}.{w + 1}" for u in self.units for w in range(layout.n_windows)]
        return number_column("counts", "u2", "spikes", "unit by unit, window by window", parts)

    def _count_blocks(self, layout: FeatureLayout) -> Iterator[Block]:
        content = self.content
        chosen = replace(self.prepared.trials, trials=self.chosen)
        prepared = self.prepared._replace(trials=chosen)
        conditions = group_by_condition(prepared, self.options.parameters, 0.0, search_c=False)
        resources = Resources(progress=content.progress)
        for one, found in zip(
            conditions, count_conditions(prepared, conditions, resources), strict=True
        ):
            counts = window_counts(found["plain"], one.bin_edges, one.speed_mm_s, layout)
            own = counts[:, self.rows].reshape(len(one.rows), -1)
            ids = np.array([trial.trial_id for trial in one.trials], np.int32)
            yield {"trial_id": ids, "counts": own.astype(np.uint16)}

    def _encode(self, trials: tuple[TrialRef, ...]) -> Block:
        prepared, parameters = self.prepared, self.options.parameters
        with open_trials(files_of_trials(prepared.trials.files, trials)) as reader:
            samples = reader.read_block(trials).arrays
        found = encode_trials(samples, prepared.normalisation, parameters)
        trains = [spikes.train(row) for spikes in found for row in self.rows]
        lengths = np.array([len(train) for train in trains])
        per_trial = lengths.reshape(len(trials), -1).sum(axis=1)
        within = np.concatenate(trains).astype(np.int64)
        rows = self.content.reader.trials[[trial.row for trial in trials]]
        rate_hz = self.content.reader.header.sample_rate_hz
        units = np.tile(np.arange(len(self.rows), dtype=np.uint16), len(trials))
        return {
            "unit": np.repeat(units, lengths),
            "counter": np.repeat(rows["first_counter"], per_trial) + within,
            TIME: np.repeat(self._starts_s(trials), per_trial) + within / rate_hz,
            "trial_id": np.repeat(rows["trial_id"], per_trial),
        }

    def _starts_s(self, trials: tuple[TrialRef, ...]) -> NDArray[np.float64]:
        rows = self.content.reader.trials[[trial.row for trial in trials]]
        times = self.content.times
        return np.array(
            [float(times[int(row["part"])].of_counter(int(row["first_counter"]))) for row in rows]
        )


def _board_spikes(content: Content) -> SpikeTrains:
    """Return the spikes that the board of the moving finger recorded."""
    sensor = content.reader.sensor_layout
    units = tuple(
        Unit(f"SA-{name}", "SA", sensor.layers[sensor.layer_of(taxel)], taxel + 1, "the board's")
        for taxel, name in zip(content.taxels, content.taxel_names, strict=True)
    )

    def blocks() -> Iterator[Block]:
        for span in content.spans:
            for start in range(span.start, span.stop, SLICE_ROWS):
                stop = min(start + SLICE_ROWS, span.stop)
                counters = span.part.read(COUNTER, start, stop)
                spikes = span.part.read(BOARD_SPIKES, start, stop)[:, content.taxels]
                at, unit = np.nonzero(spikes)
                times = np.repeat(counters[at], spikes[at, unit])
                yield {
                    "unit": np.repeat(unit.astype(np.uint16), spikes[at, unit]),
                    "counter": times,
                    TIME: span.times.of_counter(times),
                }

    observed = [
        span.times.of_counter(span.part.read(COUNTER, row, row + 1)[0] + late)
        for span in content.spans
        for row, late in ((span.start, 0), (span.stop - 1, 1))
    ]
    series = Series("spikes", DOC, COLUMNS, blocks)
    return SpikeTrains(units, np.array(observed, np.float64).reshape(-1, 2), series)
