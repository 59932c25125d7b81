"""A session as objects of Neo, in a NIX file that Neo and nixpy read.

Neo's own NWB reader fails on keywords and conversions and reads no trials, so these objects are
made here: a Block for each stretch of the recording, with one Segment that holds the readings, an
irregular signal of each measured table, a SpikeTrain of each unit, an Epoch of the attempts and the
events. NIX takes a twentieth of a second for an object, so the stretches are long and no Segment is
a trial: ``neo.utils.cut_segment_by_epoch`` cuts one.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import neo
import numpy as np
import quantities as pq
from neo.io import NixIO
from numpy.typing import NDArray

from rigctl.exchange.export.content import (
    READINGS,
    TIME,
    Block,
    Content,
    Series,
    SpikeTrains,
    join_blocks,
)

STRETCH_SAMPLES = 1 << 19
"""Samples of a Block: nine minutes, 19 MB at 18 taxels."""
EVENTS = "events"


def write_nix(content: Content, spikes: SpikeTrains | None, target: Path) -> None:
    """Write a session into a new ``.nix`` file, a Block after the other."""
    io = NixIO(str(target), "ow")
    try:
        for block in neo_blocks(content, spikes):
            io.write_block(block)
    finally:
        io.close()


def neo_blocks(content: Content, spikes: SpikeTrains | None) -> Iterator[neo.Block]:
    """Yield a Block for each stretch of a session, in the order of time."""
    about = {name: value for name, value in content.about.items() if value != ""}
    measured = [_Cursor(series) for series in content.tables if series.is_measured]
    events = next((_Cursor(series) for series in content.tables if series.name == EVENTS), None)
    trials = _Cursor(content.trials, "start_time")
    trains = None if spikes is None else _Cursor(spikes.series)
    for number, (stop_s, samples) in enumerate(_stretches(content), start=1):
        segment = neo.Segment(name=f"{about['data']}, stretch {number}")
        if content.samples is not None and len(samples[TIME]):
            _add_readings(segment, content, samples)
        for signal in _signals(measured, stop_s):
            segment.irregularlysampledsignals.append(signal)
        segment.epochs.append(_attempts(trials.take(stop_s)))
        if events is not None:
            segment.events.append(_events(events.take(stop_s)))
        if spikes is not None and trains is not None:
            for train in _trains(spikes, trains.take(stop_s)):
                segment.spiketrains.append(train)
        block = neo.Block(name=f"{content.name} {number}", **about)
        block.segments.append(segment)
        yield block


class _Cursor:
    """A series that is read once, stretch after stretch; its times ascend from block to block."""

    def __init__(self, series: Series, time: str = TIME) -> None:
        self.series = series
        self._time = time
        self._blocks = series.blocks()
        self._rest: Block | None = next(self._blocks, None)

    def take(self, stop_s: float) -> Block:
        """Return the rows before a time that were not taken yet."""
        taken: list[Block] = []
        while self._rest is not None:
            is_later = self._rest[self._time] >= stop_s
            taken.append({name: values[~is_later] for name, values in self._rest.items()})
            if is_later.any():
                self._rest = {name: values[is_later] for name, values in self._rest.items()}
                break
            self._rest = next(self._blocks, None)
        return join_blocks(self.series.columns, taken)


def _stretches(content: Content) -> Iterator[tuple[float, Block]]:
    """Yield the samples of each stretch with the time at which the next one begins."""
    series = content.every_sample
    kept = tuple(column for column in series.columns if column.name in (TIME, READINGS))
    blocks: list[Block] = []
    n = 0
    for block in series.blocks():
        if n >= STRETCH_SAMPLES:
            yield float(block[TIME][0]), join_blocks(kept, blocks)
            blocks, n = [], 0
        blocks.append({column.name: block[column.name] for column in kept})
        n += len(block[TIME])
    yield np.inf, join_blocks(kept, blocks)


def _add_readings(segment: neo.Segment, content: Content, samples: Block) -> None:
    """Add the readings: as a regular signal where none is missing."""
    time_s, readings = samples[TIME], samples[READINGS]
    rate_hz = float(content.reader.header.sample_rate_hz)
    said = {"name": "taxels", "sample_unit": content.reader.header.sample_unit}
    names = {"taxel": np.array(content.taxel_names)}
    if np.all(np.rint(np.diff(time_s) * rate_hz) == 1):
        signal = neo.AnalogSignal(
            readings,
            units=pq.dimensionless,
            sampling_rate=rate_hz * pq.Hz,
            t_start=time_s[0] * pq.s,
            array_annotations=names,
            **said,
        )
        segment.analogsignals.append(signal)
    else:
        signal = neo.IrregularlySampledSignal(
            time_s * pq.s, readings, units=pq.dimensionless, array_annotations=names, **said
        )
        segment.irregularlysampledsignals.append(signal)


def _signals(measured: list[_Cursor], stop_s: float) -> Iterator[neo.IrregularlySampledSignal]:
    """Yield a signal for each measured table, with a channel for each of its columns."""
    for cursor in measured:
        rows = cursor.take(stop_s)
        columns = [column for column in cursor.series.columns if column.name != TIME]
        if not len(rows[TIME]):
            continue
        yield neo.IrregularlySampledSignal(
            rows[TIME] * pq.s,
            np.stack([rows[column.name].astype(np.float64) for column in columns], axis=1),
            units=pq.dimensionless,
            name=cursor.series.name,
            array_annotations={
                "column": np.array([column.name for column in columns]),
                "unit": np.array([column.unit or "none" for column in columns]),
            },
        )


def _attempts(rows: Block) -> neo.Epoch:
    """Return the attempts, labelled by their trials, with every column as an annotation."""
    start_s, stop_s = rows["start_time"], rows["stop_time"]
    labels = np.array([str(trial) for trial in rows["trial_id"].tolist()], np.str_)
    return neo.Epoch(
        times=start_s * pq.s,
        durations=(stop_s - start_s) * pq.s,
        labels=labels,
        name="trials",
        array_annotations=dict(rows),
    )


def _events(rows: Block) -> neo.Event:
    labels = np.array(
        [f"{k}: {t}" for k, t in zip(rows["kind"], rows["text"], strict=True)], np.str_
    )
    return neo.Event(times=rows[TIME] * pq.s, labels=labels, name=EVENTS)


def _trains(spikes: SpikeTrains, rows: Block) -> Iterator[neo.SpikeTrain]:
    """Yield the spikes of each unit of a stretch."""
    first_s, last_s = (rows[TIME].min(), rows[TIME].max()) if len(rows[TIME]) else (0.0, 0.0)
    for number, unit in enumerate(spikes.units):
        own: NDArray[np.float64] = rows[TIME][rows["unit"] == number]
        said: dict[str, Any] = {**unit._asdict(), "taxel": unit.taxel}
        yield neo.SpikeTrain(own * pq.s, t_start=first_s * pq.s, t_stop=last_s * pq.s, **said)
