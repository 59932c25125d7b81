"""What an export holds, in blocks of bounded size and on one clock, for any format to write.

The series are the session's own data sets by the names of its layout, so that every experiment has
its own. Each is read part by part; a format writes block after block and never holds a session.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl import __version__
from rigctl.analysis.executors import Progress
from rigctl.errors import WrongUse
from rigctl.exchange.export.selection import Representation, Selection
from rigctl.exchange.export.timeline import PartTimes, part_times, session_start
from rigctl.session.extra_stream import ExtraStream
from rigctl.session.ground_truth import start_of
from rigctl.session.layout import (
    ARRIVALS,
    DRUM,
    LOADCELL,
    SAMPLES,
    ArrayLayout,
    TableLayout,
)
from rigctl.session.part import PartReader, StructuredArray
from rigctl.session.sample_index import locate_windows
from rigctl.session.session import Session
from rigctl.session.session_reader import SessionReader, read_closing_digest
from rigctl.session.trial_csv import COUNTS, NOTES, WHY_NOT, judge_attempts
from rigctl.session.writer_lock import is_being_written
from rigctl.values import ABOUT

Block = Mapping[str, NDArray[Any]]
"""Rows of a series: an array for each column, all of one length."""
SAMPLE_ROWS = 1 << 18
TABLE_ROWS = 1 << 15
SIMULATED = "SIMULATED"
TIME, READINGS = "time_s", "readings"


class Column(NamedTuple):
    """A column of a series; ``parts`` names the columns of a two-dimensional one."""

    name: str
    dtype: np.dtype[Any]
    unit: str
    doc: str
    parts: tuple[str, ...] = ()

    @property
    def is_text(self) -> bool:
        """Whether it holds text."""
        return self.dtype.kind == "U"


class Series(NamedTuple):
    """Rows of a kind; :attr:`blocks` reads them from the beginning at each call."""

    name: str
    doc: str
    columns: tuple[Column, ...]
    blocks: Callable[[], Iterator[Block]]

    @property
    def is_measured(self) -> bool:
        """Whether all that it holds are numbers at a time."""
        names = [column.name for column in self.columns]
        return TIME in names and not any(column.is_text for column in self.columns)


class Unit(NamedTuple):
    """A neuron: its name, its receptor (SA or RA), its place, taxel from 1, and its encoder."""

    name: str
    receptor: str
    layer: str
    taxel: int
    encoder: str


class SpikeTrains(NamedTuple):
    """Spikes of all units in the order of time, or of trials, and of units in each block.

    Columns of ``series``: ``unit`` (row of ``units``), ``counter`` of the sample, ``time_s``.
    ``observed_s``: float64 (n, 2), the times between which they were looked for. ``counts``: those
    in windows, for each way to cut them.
    """

    units: tuple[Unit, ...]
    observed_s: NDArray[np.float64]
    series: Series
    counts: tuple[Series, ...] = ()
    remarks: tuple[str, ...] = ()


class Span(NamedTuple):
    """Rows ``start`` … ``stop`` - 1 of the samples of a part."""

    part: PartReader
    times: PartTimes
    start: int
    stop: int


def number_column(name: str, code: str, unit: str, doc: str, parts: Sequence[str] = ()) -> Column:
    """Return a column of numbers."""
    return Column(name, np.dtype(code), unit, doc, tuple(parts))


class Content:
    """A session, or a selection of it. Raises WrongUse for what the session does not have.

    ``reader``: the open session. ``progress`` takes what is read, and may raise to end an export.
    """

    def __init__(
        self,
        reader: SessionReader,
        selection: Selection,
        progress: Progress = lambda stage, done, total: None,
    ) -> None:
        self.reader, self.selection, self.progress = reader, selection, progress
        self.times = part_times(reader.parts)
        self.attempts = self._selected_attempts()
        self.taxels = self._selected_taxels()
        """The exported taxels, counted from 0."""
        self.taxel_names = [reader.sensor_layout.names[taxel] for taxel in self.taxels]

    @property
    def name(self) -> str:
        """Name of the session's folder."""
        return self.reader.path.absolute().name

    @property
    def simulated(self) -> bool:
        """Whether a simulated bench was recorded."""
        return self.reader.header.simulated

    @cached_property
    def about(self) -> dict[str, str | int | float]:
        """Plain values about the session; ``data`` says first that it is simulated."""
        header, reader = self.reader.header, self.reader
        parameters = header.encoder_parameters
        return {
            "data": f"{SIMULATED} data" if self.simulated else "recorded data",
            "simulated": int(self.simulated),
            "session": self.name,
            "experiment": header.experiment,
            "start_utc": session_start(reader.parts).isoformat(),
            "protocol": header.protocol,
            "plan_hash": header.plan_hash,
            "seed": header.seed,
            "rig": header.rig,
            **{name: getattr(header, name) for name in ABOUT},
            **{f"own_{_plain_name(name)}": text for name, text in header.own.items()},
            "recorded_by": f"rigctl {header.software_version} {header.software_commit}".strip(),
            **({"plugins": header.plugin_names} if header.plugins else {}),
            "exported_by": f"rigctl {__version__}",
            "closing_digest": read_closing_digest(reader.path),
            "sample_rate_hz": header.sample_rate_hz,
            "sample_unit": header.sample_unit,
            "encoder_of_the_recording": parameters.name,
            "selected_trials": len(set(reader.trials["trial_id"][self.attempts].tolist())),
            "whole": int(self.selection.is_whole),
            "notes": "\n".join(n.describe() for n in reader.notes if not n.trial_id),
            "protocol_toml": reader.protocol_text,
            "rig_toml": reader.rig_text,
        }

    @property
    def remarks(self) -> list[str]:
        """A sentence on each thing that is missing."""
        lines = self.reader.describe_missing()
        if is_being_written(self.reader.path):
            lines.append("it is still being recorded: the export has what was there when it began")
        elif not self.reader.finished:
            lines.append("it was not closed: rigctl recover says what that means")
        return lines

    @property
    def trial_times_s(self) -> NDArray[np.float64]:
        """Start and end of each exported attempt, float64 (n, 2).

        Of its samples; of an attempt without any, of all that the rig did.
        """
        rows = self.reader.trials[self.attempts]
        found = np.stack([rows["started_s"], rows["ended_s"]], axis=1)
        for number, times in self.times.items():
            own = rows["part"] == number
            found[own] = times.of_loop(found[own])
            here = own & (rows["first_counter"] >= 0)
            first = rows["first_counter"][here]
            ends = (first, first + rows["count"][here])
            found[here] = np.stack([times.of_counter(each) for each in ends], axis=1)
        return found

    @property
    def trials(self) -> Series:
        """All exported attempts with their times and what is said of them."""
        layout = self.reader.layout.trials
        judged = judge_attempts(self.reader)
        texts = {
            COUNTS: ("yes where the attempt counts, else no", [each[0] for each in judged]),
            WHY_NOT: ("why it does not count", [each[1] for each in judged]),
            NOTES: ("what people noted on it", [each[2] for each in judged]),
        }
        said = {n: np.array(values, np.str_)[self.attempts] for n, (_, values) in texts.items()}
        rows, at_s = self.reader.trials[self.attempts], self.trial_times_s
        block = {"start_time": at_s[:, 0], "stop_time": at_s[:, 1]}
        block |= {column.name: rows[column.name] for column in layout.columns} | said
        columns = (
            number_column("start_time", "f8", "s", "time of its first sample"),
            number_column("stop_time", "f8", "s", "time of the end of its last sample"),
            *_columns_of(layout),
            *(Column(n, said[n].dtype, "", doc) for n, (doc, _) in texts.items()),
        )
        return Series("trials", layout.doc, columns, lambda: iter([block]))

    @property
    def taxel_table(self) -> Series:
        """A row for each exported taxel: where it is, and which reading of the wire."""
        sensor, reader = self.reader.sensor_layout, self.reader
        wiring = reader.wiring if isinstance(reader, Session) else ()
        block = {
            "taxel": np.array(self.taxels, np.int64) + 1,
            "taxel_name": np.array(self.taxel_names, np.str_),
            "layer": np.array([sensor.layers[sensor.layer_of(t)] for t in self.taxels], np.str_),
            "row": np.array([sensor.row_of(t) + 1 for t in self.taxels], np.int64),
            "column": np.array([t % sensor.columns + 1 for t in self.taxels], np.int64),
            "reading": np.array([wiring[t] if wiring else -1 for t in self.taxels], np.int64),
        }
        docs = (
            "number, from 1",
            "layer and number",
            "layer, from the top",
            "row in its layer, from 1",
            "column in its layer, from 1",
            "reading of the taxel wire, from 0; -1 where the session does not say",
        )
        return table_series("taxels", "the taxels, in the order of their columns", block, docs)

    @property
    def samples(self) -> Series | None:
        """:attr:`every_sample`, None where no readings are wanted."""
        is_wanted = Representation.READINGS in self.selection.representations
        return self.every_sample if is_wanted else None

    @property
    def every_sample(self) -> Series:
        """The readings with counter, flags and what else the board says of each sample."""
        columns = [number_column(TIME, "f8", "s", "time since the start of the session")]
        for array in self.reader.layout.arrays:
            names = self.taxel_names if array.per_taxel else ()
            unit = self.reader.header.sample_unit if array.raw else array.unit
            name = _array_name(array)
            columns.append(number_column(name, array.type_code, unit, array.doc, names))
        return Series("samples", "one row a sample", tuple(columns), self._sample_blocks)

    @property
    def n_samples(self) -> int:
        """Number of exported samples."""
        return sum(span.stop - span.start for span in self.spans)

    @cached_property
    def spans(self) -> tuple[Span, ...]:
        """The exported samples: whole parts, or the windows of the chosen trials."""
        spans = []
        for part in self.reader.parts:
            times = self.times[part.number]
            spans += [Span(part, times, *rows) for rows in self._rows_of_samples(part)]
        return tuple(spans)

    def _rows_of_samples(self, part: PartReader) -> list[tuple[int, int]]:
        if self.selection.is_whole:
            return [(0, part.n_samples)] if part.n_samples else []
        windows = locate_windows(part, self._attempts_in(part), 0)
        return sorted((w.start, w.stop) for w in windows if w.stop > w.start)

    def _sample_blocks(self) -> Iterator[Block]:
        done, total = 0, self.n_samples
        for span in self.spans:
            for start in range(span.start, span.stop, SAMPLE_ROWS):
                stop = min(start + SAMPLE_ROWS, span.stop)
                self.progress("reading samples", done, total)
                yield self._sample_block(span, start, stop)
                done += stop - start
        self.progress("reading samples", done, max(1, total))

    def _sample_block(self, span: Span, start: int, stop: int) -> Block:
        block: dict[str, NDArray[Any]] = {}
        for array in self.reader.layout.arrays:
            values = span.part.read(array.path, start, stop)
            block[_array_name(array)] = values[:, self.taxels] if array.per_taxel else values
        return {TIME: span.times.of_counter(block["counter"]), **block}

    @property
    def tables(self) -> tuple[Series, ...]:
        """The session's other tables, events and gaps among them, and the streams beside it."""
        layout = self.reader.layout
        tables = [each for each in layout.tables if each not in (layout.trials, ARRIVALS)]
        streams = [self._stream(stream) for stream in self.reader.streams]
        return (*map(self._table, tables), *streams)

    def _stream(self, stream: ExtraStream) -> Series:
        columns = [
            number_column(TIME, "f8", "s", "time since the start of the session"),
            number_column("lsl_s", "f8", "s", "time stamp of the sender"),
        ]
        if stream.is_text:
            columns.append(Column("text", np.dtype("U512"), "", "what was sent"))
        else:
            units = ", ".join(dict.fromkeys(filter(None, stream.units)))
            doc = f"channels of {stream.name}"
            columns.append(number_column("value", stream.type_code, units, doc, stream.channels))
        name = f"stream_{stream.number}_{_plain_name(stream.name)}"
        doc = f"LSL stream {stream.name}, type {stream.kind}, of {stream.host}"
        return Series(name, doc, tuple(columns), lambda: self._stream_blocks(stream))

    def _stream_blocks(self, stream: ExtraStream) -> Iterator[Block]:
        stage = f"reading {stream.path.name}"
        parts = [part for part in self.reader.parts if start_of(part.attributes) == stream.start]
        for start in range(0, stream.n_rows if parts else 0, TABLE_ROWS):
            self.progress(stage, start, stream.n_rows)
            stop = min(start + TABLE_ROWS, stream.n_rows)
            loop_s = stream.times_s(start, stop)
            values = stream.values(start, stop)
            block = {
                TIME: self._times_beside(parts, loop_s),
                "lsl_s": stream.lsl_s(start, stop),
                "text" if stream.is_text else "value": values,
            }
            if not self.selection.is_whole:
                rows = self.reader.trials[self.attempts]
                own = rows[np.isin(rows["part"], [part.number for part in parts])]
                kept = _is_between(loop_s, own["started_s"], own["ended_s"])
                block = {key: column[kept] for key, column in block.items()}
            yield block
        self.progress(stage, 1, 1)

    def _times_beside(
        self, parts: Sequence[PartReader], loop_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the times of loop times of a sitting, each by the clock of the part then open."""
        clocks = [self.times[part.number] for part in parts]
        begins = np.array([clock.loop_s[0] for clock in clocks])
        which = np.maximum(np.searchsorted(begins, loop_s, "right") - 1, 0)
        found = np.empty(len(loop_s))
        for index in np.unique(which):
            found[which == index] = clocks[index].of_loop(loop_s[which == index])
        return found

    def _table(self, table: TableLayout) -> Series:
        name = table.path.strip("/")
        columns = (
            number_column(TIME, "f8", "s", "time since the start of the session"),
            number_column("part", "i2", "", "part of the session that holds the row"),
            *_columns_of(table),
        )
        if not _has_time(table):
            columns = columns[1:]
        return Series(name, table.doc, columns, lambda: self._table_blocks(table))

    def _table_blocks(self, table: TableLayout) -> Iterator[Block]:
        total = sum(part.n_rows(table) for part in self.reader.parts)
        done, stage = 0, f"reading {table.path.strip('/')}"
        for part in self.reader.parts:
            clock = _drum_clock(part) if table is LOADCELL else None
            for start in range(0, part.n_rows(table), TABLE_ROWS):
                self.progress(stage, done, total)
                rows = part.rows(table, start, start + TABLE_ROWS)
                done += len(rows)
                yield self._table_block(table, part, rows, clock)
        self.progress(stage, 1, 1)

    def _table_block(
        self, table: TableLayout, part: PartReader, rows: StructuredArray, clock: Clock | None
    ) -> Block:
        loop_s = None
        if clock is not None:
            loop_s = _loop_times(rows["board_time_us"], clock)
        elif _has_time(table):
            loop_s = rows["at_s"]
        if not self.selection.is_whole:
            kept = self._is_selected(table, part, rows, loop_s)
            rows, loop_s = rows[kept], None if loop_s is None else loop_s[kept]
        block = {"part": np.full(len(rows), part.number, np.int16)}
        block |= {column.name: rows[column.name] for column in table.columns}
        if loop_s is None:
            return block
        return {TIME: self.times[part.number].of_loop(loop_s), **block}

    def _is_selected(
        self, table: TableLayout, part: PartReader, rows: StructuredArray, loop_s: Any
    ) -> NDArray[np.bool_]:
        """Return which rows belong to the chosen attempts, bool (n,)."""
        own = self._attempts_in(part)
        if table.place == "scan":
            return np.isin(rows["scan"], own["scan"])
        if loop_s is not None:
            return _is_between(loop_s, own["started_s"], own["ended_s"])
        if table.place == "row":
            first = own["first_sample"]
            return _is_between(rows["row"], first, first + own["count"])
        return np.ones(len(rows), bool)

    def _attempts_in(self, part: PartReader) -> StructuredArray:
        rows = self.reader.trials[self.attempts]
        own: StructuredArray = rows[rows["part"] == part.number]
        return own

    def _selected_attempts(self) -> NDArray[np.intp]:
        ids = self.reader.trials["trial_id"]
        wanted = self.selection.trials
        if lacking := wanted - set(ids.tolist()):
            raise WrongUse(
                f"{self.reader.path} has no trial {min(lacking)}: `rigctl info` lists what it has"
            )
        return np.flatnonzero(np.isin(ids, list(wanted))) if wanted else np.arange(len(ids))

    def _selected_taxels(self) -> list[int]:
        n, wanted = self.reader.header.n_taxels, self.selection.taxels
        if wanted and max(wanted) > n:
            raise WrongUse(f"{self.reader.path} has {n} taxels: there is no taxel {max(wanted)}")
        return sorted(taxel - 1 for taxel in wanted) or list(range(n))


def table_series(name: str, doc: str, block: Block, docs: Sequence[str]) -> Series:
    """Return a series of one block of columns without units."""
    columns = zip(block.items(), docs, strict=True)
    named = tuple(Column(column, values.dtype, "", text) for (column, values), text in columns)
    return Series(name, doc, named, lambda: iter([block]))


def joined(series: Series) -> Block:
    """Return all rows of a series that fits into memory."""
    return join_blocks(series.columns, list(series.blocks()))


def join_blocks(columns: Sequence[Column], blocks: Sequence[Block]) -> Block:
    """Return the rows of blocks of these columns in one block."""
    if blocks:
        return {c.name: np.concatenate([block[c.name] for block in blocks]) for c in columns}
    widths = {c.name: (len(c.parts),) if c.parts else () for c in columns}
    return {c.name: np.zeros((0, *widths[c.name]), c.dtype) for c in columns}


def _array_name(array: ArrayLayout) -> str:
    return READINGS if array.path == SAMPLES else array.path.rpartition("/")[2]


def _columns_of(table: TableLayout) -> tuple[Column, ...]:
    return tuple(
        Column(c.name, np.dtype(c.type_code.replace("S", "U")), c.unit, c.doc)
        for c in table.columns
    )


def _plain_name(name: str) -> str:
    """Return a name of letters, digits and underscores, as files and MATLAB's structures want."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:40] or "stream"


def _has_time(table: TableLayout) -> bool:
    return table is LOADCELL or any(column.name == "at_s" for column in table.columns)


Clock = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Times of the drum's clock, µs, ascending, and by how much the loop's is ahead of it, s."""


def _drum_clock(part: PartReader) -> Clock:
    """Return both clocks at the polls of a part."""
    polls = part.rows(DRUM)
    order = np.argsort(polls["board_time_us"], kind="stable")
    board_us = polls["board_time_us"][order]
    return board_us, polls["at_s"][order] - board_us * 1e-6


def _loop_times(board_us: NDArray[np.int64], clock: Clock) -> NDArray[np.float64]:
    """Return the loop times of times of the drum's clock; NaN where it was never polled."""
    if not len(clock[0]):
        return np.full(len(board_us), np.nan)
    return np.asarray(board_us * 1e-6 + np.interp(board_us, *clock))


def _is_between(values: NDArray[Any], first: NDArray[Any], last: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which values lie in one of some intervals that do not overlap, bool (n,)."""
    if not len(first):
        return np.zeros(len(values), bool)
    order = np.argsort(first, kind="stable")
    at = np.searchsorted(first[order], values, "right") - 1
    inside: NDArray[np.bool_] = (at >= 0) & (values <= last[order][np.maximum(at, 0)])
    return inside
