"""A session as one NWB file (schema 2), for pynwb, SpikeInterface, pynapple and MatNWB.

Samples and polls are acquisitions, in the numbers of the session with NWB's conversion to SI units.
Trials, events and gaps are NWB's own tables, neurons its units; the other tables of a session are
tables of the processing module ``misc``. Rows of samples, polls and spikes go into the file block
by block, once their data sets are there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Any, NamedTuple
from uuid import NAMESPACE_URL, uuid5

import h5py
import numpy as np
from hdmf.backends.hdf5.h5_utils import H5DataIO
from hdmf.common import (
    DynamicTable,
    DynamicTableRegion,
    ElementIdentifiers,
    VectorData,
    VectorIndex,
)
from numpy.typing import NDArray
from pynwb import NWBHDF5IO, NWBFile, TimeSeries
from pynwb.epoch import TimeIntervals
from pynwb.event import EventsTable, TimestampVectorData
from pynwb.misc import Units

from rigctl.exchange.export.content import (
    SIMULATED,
    TIME,
    Column,
    Content,
    Series,
    SpikeTrains,
    joined,
)
from rigctl.exchange.export.timeline import session_start
from rigctl.values import ABOUT

COMPRESSED = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
CHUNK_BYTES = 1 << 20
SI = {
    "g": ("newtons", 9.80665e-3),
    "mm/s": ("m/s", 1e-3),
    "µm/s": ("m/s", 1e-6),
    "mm": ("m", 1e-3),
    "µm": ("m", 1e-6),
    "°": ("radians", pi / 180),
    "µs": ("seconds", 1e-6),
    "s": ("seconds", 1.0),
}
"""Unit in SI, and what a number in the session's unit is multiplied by."""
NAMES = {
    "drum_force_g": "force",
    "drum_speed_mm_s": "surface_speed",
    "drum_angle_deg": "drum_angle",
    "samples_readings": "taxels",
}
"""Acquisitions that a reader looks for first; the others are called by table and column."""
NOT_ACQUIRED = (TIME, "part", "at_s", "counter")
EVENTS, GAPS = "events", "gaps"


class _Filling(NamedTuple):
    """Data sets of a series that get their rows when the file is there, by column."""

    series: Series
    columns: Mapping[str, H5DataIO]


def write_nwb(content: Content, spikes: SpikeTrains | None, target: Path) -> None:
    """Write a session into a new ``.nwb`` file."""
    nwb = _empty_file(content)
    misc = nwb.create_processing_module(name="misc", description="the sensor, and what the rig did")
    taxels = _table(content.taxel_table)
    misc.add(taxels)
    fillings = [_add_samples(nwb, content)]
    for series in content.tables:
        if series.name == EVENTS:
            nwb.add_events_table(_events(series))
        elif series.name == GAPS:
            _add_gaps(nwb, content, series)
        elif series.is_measured:
            fillings.append(_add_acquisitions(nwb, series, None))
        else:
            misc.add(_table(series))
    nwb.trials = _trials(content.trials)
    counted: NDArray[np.int64] = np.zeros(0, np.int64)
    spike_times = None
    if spikes is not None:
        counted = _count_spikes(spikes)
        nwb.units, spike_times = _units(content, spikes, counted, taxels)
        for series in spikes.counts:
            misc.add(_table(series))
    # HDF5's cache of chunks grows and does not come back; blocks are larger than chunks.
    with h5py.File(target, "w", rdcc_nbytes=0) as file, NWBHDF5IO(file=file, mode="w") as io:
        io.write(nwb)
        for filling in filter(None, fillings):
            _fill(filling)
        if spikes is not None and spike_times is not None:
            _fill_spikes(spike_times, spikes.series, counted)


def _empty_file(content: Content) -> NWBFile:
    about = content.about
    origin = f"{SIMULATED} data: " if content.simulated else ""
    digest = about["closing_digest"] or f"{about['plan_hash']} {about['start_utc']}"
    people = {"experimenter": [operator]} if (operator := str(about["operator"])) else {}
    nwb = NWBFile(
        session_description=f"{origin}protocol {about['protocol']}, rig {about['rig']}",
        identifier=str(uuid5(NAMESPACE_URL, f"rigctl:{digest}")),
        session_start_time=session_start(content.reader.parts),
        session_id=content.name,
        experiment_description=f"{origin}tactile textures, experiment {about['experiment']}",
        keywords=["tactile", "texture", *(["simulated"] if content.simulated else [])],
        protocol=str(about["protocol"]) or None,
        notes=_said(content) or None,
        institution="not stated",
        source_script="rigctl export",
        source_script_file_name="rigctl/exchange/export/nwb.py",
        was_generated_by=[["rigctl", str(about["exported_by"]).removeprefix("rigctl ")]],
        **people,
    )
    nwb.create_device(name="taxels", description=f"{content.reader.header.n_taxels} taxels")
    for name, text, doc in (
        ("about", json.dumps(about, ensure_ascii=False), "what the session says of itself, JSON"),
        ("protocol_toml", str(about["protocol_toml"]), "the protocol, TOML"),
        ("rig_toml", str(about["rig_toml"]), "the rig, TOML"),
    ):
        nwb.add_scratch(text, name=name, description=doc)
    return nwb


def _said(content: Content) -> str:
    """Return what people said of the session at its start and later, a line each."""
    header = content.reader.header
    named = {name.replace("_", " "): getattr(header, name) for name in ABOUT} | header.own
    lines = [f"{name}: {text}" for name, text in named.items() if text]
    return "\n".join([*lines, *filter(None, [str(content.about["notes"])])])


def _add_samples(nwb: NWBFile, content: Content) -> _Filling | None:
    """Add the readings, on a rate where none is missing and else with the time of each."""
    series = content.samples
    return None if series is None else _add_acquisitions(nwb, series, _regular_clock(content))


def _regular_clock(content: Content) -> dict[str, float] | None:
    """Return rate and start of the samples if each follows the one before, else None."""
    ticks = []
    for span in content.spans:
        counters = [
            span.part.read("/taxels/counter", r, r + 1)[0] for r in (span.start, span.stop - 1)
        ]
        if counters[1] - counters[0] != span.stop - span.start - 1:
            return None
        ticks.append([int(c) - span.times.first_counter + span.times.first_tick for c in counters])
    if not ticks or any(b[0] != a[1] + 1 for a, b in pairwise(ticks)):
        return None
    rate_hz = content.spans[0].times.rate_hz
    return {"rate": rate_hz, "starting_time": ticks[0][0] / rate_hz}


def _add_acquisitions(nwb: NWBFile, series: Series, regular: dict[str, float] | None) -> _Filling:
    """Add a time series for each column; the first one holds the time stamps of all."""
    data: dict[str, H5DataIO] = {}
    clock: dict[str, Any] = regular or {}
    if regular is None:
        time = next(column for column in series.columns if column.name == TIME)
        data[TIME] = _empty_data(time)
        clock = {"timestamps": data[TIME]}
    for column in series.columns:
        if column.name in NOT_ACQUIRED:
            continue
        data[column.name] = _empty_data(column)
        full = f"{series.name}_{column.name}"
        unit, conversion = SI.get(column.unit, (column.unit or "n.a.", 1.0))
        one = TimeSeries(
            name=NAMES.get(full, full),
            data=data[column.name],
            unit=unit,
            conversion=conversion,
            description=column.doc,
            comments=", ".join(column.parts) or "no comments",
            **clock,
        )
        nwb.add_acquisition(one)
        if regular is None:
            clock = {"timestamps": one}
    return _Filling(series, data)


def _empty_data(column: Column) -> H5DataIO:
    width = (len(column.parts),) if column.parts else ()
    row_bytes = column.dtype.itemsize * max(1, len(column.parts))
    return H5DataIO(
        shape=(0, *width),
        dtype=column.dtype,
        maxshape=(None, *width),
        chunks=(max(1, CHUNK_BYTES // row_bytes // 8), *width),
        **COMPRESSED,
    )


def _fill(filling: _Filling) -> None:
    """Append the blocks of a series to its data sets."""
    for block in filling.series.blocks():
        for name, data in filling.columns.items():
            rows, dataset = block[name], data.dataset
            end = len(dataset)
            dataset.resize(end + len(rows), axis=0)
            dataset[end:] = rows


def _events(series: Series) -> EventsTable:
    block = joined(series)
    columns: list[VectorData] = [
        TimestampVectorData(name="timestamp", description="time of the event", data=block[TIME])
    ]
    kept = [column for column in series.columns if column.name in ("kind", "text")]
    columns += [_vector(column, block[column.name]) for column in kept]
    columns.append(_texts("details", "name = value; …", list(map(_details, block["data"]))))
    return EventsTable(name=EVENTS, description=series.doc, columns=columns)


def _details(text: str) -> str:
    """Return the details of an event, which NWB wants as no JSON, as words."""
    try:
        data = json.loads(text)
    except json.JSONDecodeError:
        return text
    values = data.items() if isinstance(data, dict) else ()
    return "; ".join(f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in values)


def _add_gaps(nwb: NWBFile, content: Content, series: Series) -> None:
    """Add the gaps between samples as invalid times."""
    block = joined(series)
    for part, first, count, reason in zip(
        *(block[name].tolist() for name in ("part", "first_counter", "count", "reason")),
        strict=True,
    ):
        start_s, stop_s = content.times[part].of_counter(np.array([first, first + count]))
        nwb.add_invalid_time_interval(start_time=start_s, stop_time=stop_s, tags=[reason or GAPS])


def _trials(series: Series) -> TimeIntervals:
    return TimeIntervals(name="trials", description=series.doc, columns=_vectors(series))


def _table(series: Series) -> DynamicTable:
    return DynamicTable(name=series.name, description=series.doc, columns=_vectors(series))


def _vectors(series: Series) -> list[VectorData]:
    block = joined(series)
    return [_vector(column, block[column.name]) for column in series.columns]


def _vector(column: Column, values: NDArray[Any]) -> VectorData:
    unit = f" [{column.unit}]" if column.unit else ""
    data = values.tolist() if column.is_text else values
    if column.is_text and not len(values):  # a list without a text does not say that it has texts
        data = H5DataIO(shape=(0,), dtype=h5py.string_dtype(), maxshape=(None,))
    description = f"{column.doc}{unit}" + (f": {', '.join(column.parts)}" if column.parts else "")
    return VectorData(name=column.name, description=description, data=data)


def _count_spikes(spikes: SpikeTrains) -> NDArray[np.int64]:
    """Return the spikes of each unit, which lay out the file before any is written."""
    counts = np.zeros(len(spikes.units), np.int64)
    for block in spikes.series.blocks():
        counts += np.bincount(block["unit"], minlength=len(counts))
    return counts


def _units(
    content: Content, spikes: SpikeTrains, counts: NDArray[np.int64], taxels: DynamicTable
) -> tuple[Units, H5DataIO]:
    """Return the units, and the data set of all their spikes, unit after unit."""
    n, n_windows = len(counts), len(spikes.observed_s)
    times = H5DataIO(
        shape=(int(counts.sum()),),
        dtype=np.float64,
        maxshape=(None,),
        chunks=(1 << 13,),
        **COMPRESSED,
    )
    trains = VectorData(name="spike_times", description="times of the spikes", data=times)
    windows = VectorData(
        name="obs_intervals",
        description="times between which spikes were looked for",
        data=np.tile(spikes.observed_s, (n, 1)),
    )
    places = [content.taxels.index(unit.taxel - 1) for unit in spikes.units]
    ends = np.cumsum(counts).astype(np.uint64)
    columns = [
        trains,
        VectorIndex(name="spike_times_index", data=ends, target=trains),
        windows,
        VectorIndex(
            name="obs_intervals_index",
            data=(np.arange(1, n + 1) * n_windows).astype(np.uint64),
            target=windows,
        ),
        _texts("unit_name", "name of the train", [u.name for u in spikes.units]),
        _texts("receptor", "SA or RA model neuron", [u.receptor for u in spikes.units]),
        _texts("layer", "layer of its taxel", [u.layer for u in spikes.units]),
        DynamicTableRegion(name="taxel", description="its taxel", data=places, table=taxels),
        _texts("encoder", "preset of the encoder", [u.encoder for u in spikes.units]),
    ]
    rate_hz = content.reader.header.sample_rate_hz
    origin = f"{SIMULATED} data: " if content.simulated else ""
    units = Units(
        name="units",
        description=f"{origin}model neurons of the taxels, from rest at the start of each trial",
        resolution=1.0 / rate_hz,
        id=ElementIdentifiers(name="id", data=list(range(n))),
        columns=columns,
        colnames=[c.name for c in columns if not isinstance(c, VectorIndex)],
    )
    return units, times


def _texts(name: str, doc: str, values: Sequence[str]) -> VectorData:
    return VectorData(name=name, description=doc, data=list(values))


def _fill_spikes(times: H5DataIO, series: Series, counts: NDArray[np.int64]) -> None:
    """Write the spikes of each block behind those of their units before."""
    at = np.cumsum(counts) - counts
    for block in series.blocks():
        order = np.argsort(block["unit"], kind="stable")
        found = np.bincount(block["unit"], minlength=len(counts))
        first = 0
        for unit in np.flatnonzero(found):
            end = first + found[unit]
            times.dataset[at[unit] : at[unit] + found[unit]] = block[TIME][order[first:end]]
            at[unit] += found[unit]
            first = end
