"""A session as a folder of tables: Parquet for pandas, Polars, DuckDB and R, or CSV.

Each series is a table, ``about.json`` says what the session is. Every table of a simulated session
has a column that says so.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from rigctl.exchange.export.content import (
    READINGS,
    Block,
    Column,
    Content,
    Series,
    SpikeTrains,
    table_series,
)

ORIGIN = "simulated"
OpenTable = Callable[[Path, pa.Schema], AbstractContextManager[Any]]


def write_parquet(content: Content, spikes: SpikeTrains | None, target: Path) -> None:
    """Write a folder of ``.parquet`` files."""
    open_table: OpenTable = partial(pq.ParquetWriter, compression="zstd")
    _write_folder(content, spikes, target, ".parquet", open_table)


def write_csv(content: Content, spikes: SpikeTrains | None, target: Path) -> None:
    """Write a folder of ``.csv`` files: UTF-8, commas, decimal points."""
    _write_folder(content, spikes, target, ".csv", pa_csv.CSVWriter)


def all_series(content: Content, spikes: SpikeTrains | None) -> list[Series]:
    """Return every series of an export, the samples first."""
    found = [content.samples] if content.samples is not None else []
    found += [content.trials, content.taxel_table, *content.tables]
    if spikes is not None:
        found += [unit_table(spikes), spikes.series, *spikes.counts]
    return found


def unit_table(spikes: SpikeTrains) -> Series:
    """Return a row for each unit."""
    units = spikes.units
    names = ("name", "receptor", "layer", "taxel", "encoder")
    block = {"unit": np.arange(len(units), dtype=np.uint16)}
    block |= {name: np.array([getattr(unit, name) for unit in units]) for name in names}
    docs = (
        "number in the table of spikes, from 0",
        "name of the train",
        "SA or RA model neuron",
        "layer of its taxel",
        "its taxel, from 1",
        "preset of the encoder",
    )
    return table_series("units", "one row a unit", block, docs)


def _write_folder(
    content: Content,
    spikes: SpikeTrains | None,
    target: Path,
    suffix: str,
    open_table: OpenTable,
) -> None:
    about = json.dumps(content.about, ensure_ascii=False, indent=1)
    (target / "about.json").write_text(f"{about}\n", encoding="utf-8")
    columns = {}
    for series in all_series(content, spikes):
        schema = _schema(series, content)
        columns[series.name] = {
            "doc": series.doc,
            "columns": {c.name: f"{c.doc} [{c.unit or 'none'}]" for c in series.columns},
        }
        with open_table(target / f"{series.name}{suffix}", schema) as file:
            for block in series.blocks():
                file.write_table(_table(series, block, schema))
    described = json.dumps(columns, ensure_ascii=False, indent=1)
    (target / "columns.json").write_text(f"{described}\n", encoding="utf-8")


def _schema(series: Series, content: Content) -> pa.Schema:
    fields = [
        pa.field(
            name,
            pa.string() if column.is_text else pa.from_numpy_dtype(column.dtype),
            metadata={"unit": column.unit, "doc": column.doc},
        )
        for column in series.columns
        for name in _names(column)
    ]
    if content.simulated:
        fields.append(pa.field(ORIGIN, pa.bool_()))
    return pa.schema(fields, {"rigctl": json.dumps(content.about, ensure_ascii=False)})


def _names(column: Column) -> tuple[str, ...]:
    if not column.parts:
        return (column.name,)
    prefix = "" if column.name in (READINGS, "counts") else f"{column.name}_"
    return tuple(f"{prefix}{part}" for part in column.parts)


def _table(series: Series, block: Block, schema: pa.Schema) -> pa.Table:
    arrays: list[Any] = []
    for column in series.columns:
        values = block[column.name]
        if column.parts:
            arrays += [np.ascontiguousarray(values[:, k]) for k in range(len(column.parts))]
        else:
            arrays.append(values.astype(object) if column.is_text else np.ascontiguousarray(values))
    if len(schema) > len(arrays):
        arrays.append(np.ones(len(arrays[0]), bool))
    return pa.table(
        [pa.array(a, f.type) for a, f in zip(arrays, schema, strict=True)], schema=schema
    )
