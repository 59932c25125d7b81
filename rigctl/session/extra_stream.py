"""A stream of another program, recorded beside a session: ``stream-0001.h5`` and so on.

Rows are as they came, with the time stamps of their sender. Two tables lead from these to the
session: ``clock`` to the LSL clock of the computer that recorded, ``session_clock`` from that to
the loop time of the session's polls, events and arrivals of samples.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.hdf5_file import Attributes, DataSetSchema, damage, parse_json, text
from rigctl.session.layout import (
    DIGESTS,
    SAMPLE_UNIT,
    TEXTS,
    ArrayLayout,
    Column,
    Row,
    SessionLayout,
    TableLayout,
    clip_text,
)
from rigctl.session.part import PREVIOUS_DIGEST, open_appended, readable_rows
from rigctl.session.writer_lock import is_being_written

LAYOUT = "rigctl-stream"
LAYOUT_VERSION = 1
STREAM_KIND = "stream"
"""Kind of the events of streams; one with ``file`` in its data says the file's last digest."""
KNOT_S = 10.0
"""Time in which the earliest reading of the session's clock is sought: the others came late."""
TYPE_CODES = ("f4", "f8", "i1", "i2", "i4", "i8")
TEXT_CODE = "text"
_NAME = re.compile(r"stream-([0-9]{4,6})\.h5")

_LSL = Column("lsl_s", "f8", "s", "time stamp of the sender, by its own LSL clock")
STAMPS = ArrayLayout("/stream/lsl_s", "lsl_s", "f8", "s", _LSL.doc)
VALUES = "/stream/values"
MARKERS = TableLayout(
    "/stream/texts",
    "one row for each text",
    256,
    (_LSL, Column("text", "S512", "", "its channels, joined by tabs")),
)
CLOCK = TableLayout(
    "/stream/clock",
    "how far the sender's clock is behind that of the computer that recorded",
    64,
    (
        Column("at_s", "f8", "s", "LSL clock of the computer that recorded"),
        Column("correction_s", "f8", "s", "to add to a time stamp of the sender"),
    ),
)
SESSION_CLOCK = TableLayout(
    "/stream/session_clock",
    "the session's clock beside the LSL clock; a reading may be late, and is never early",
    64,
    (
        Column("loop_s", "f8", "s", "loop time of the session"),
        Column("at_s", "f8", "s", "LSL clock of the computer that recorded, when it was read"),
    ),
)
END = TableLayout(
    "/stream/end",
    "one row, written when the stream or the session ended",
    1,
    (
        Column("n_rows", "i8", "rows", "rows that were recorded"),
        Column("reason", "S128", "", "why it ended"),
    ),
)


def stream_layout(type_code: str) -> SessionLayout:
    """Return the data sets of a stream of this type: one of the codes above."""
    clocks = (CLOCK, SESSION_CLOCK, END)
    if type_code == TEXT_CODE:
        return SessionLayout("stream", "stream", (), (MARKERS, *clocks), END)
    doc = "one column for each channel; attribute `channels`: their names"
    values = ArrayLayout(VALUES, "values", type_code, SAMPLE_UNIT, doc, per_taxel=True, raw=True)
    return SessionLayout("stream", "stream", (values, STAMPS), clocks, END)


def stream_number(path: Path) -> int:
    """Return the number in the name of a stream's file, 0 for another file."""
    found = _NAME.fullmatch(path.name)
    return int(found[1]) if found else 0


def stream_paths(folder: Path) -> list[Path]:
    """Return the files of the streams beside a session, in the order in which they began."""
    return sorted(filter(stream_number, folder.glob("stream-*.h5")), key=stream_number)


def next_stream_path(folder: Path) -> Path:
    """Return the path of the next stream's file."""
    number = max(map(stream_number, stream_paths(folder)), default=0) + 1
    return folder / f"stream-{number:04d}.h5"


def stream_attributes(
    *, type_code: str, channels: tuple[str, ...], units: tuple[str, ...], **others: Any
) -> Attributes:
    """Return the attributes of a stream's file; ``others``: plain values by name."""
    return {
        "layout": LAYOUT,
        "layout_version": LAYOUT_VERSION,
        "type_code": type_code,
        "channels": json.dumps(channels, ensure_ascii=False),
        "units": json.dumps(units, ensure_ascii=False),
        "sample_unit": "attribute `units`",
        **others,
    }


def marker_row(lsl_s: float, texts: list[str]) -> Row:
    """Return the row of a text; one that is too long is cut."""
    return lsl_s, clip_text("\t".join(texts), MARKERS.columns[-1].text_bytes)


class ExtraStream:
    """A stream beside a session as of when it was opened. Close it after use.

    ``name``, ``kind``: what the sender calls it, ``host``: the sender's computer, ``rate_hz``: 0
    for no regular one. ``channels``, ``units``: a text for each column. ``asked``: the words of
    ``recording.streams`` that found it. ``start``: that of the sitting whose parts lie beside it.
    ``reason``: why it ended, empty where nobody wrote that. Raises SessionError for a damaged file.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.number = path, stream_number(path)
        self.file = open_appended(path, is_being_written(path.parent))
        try:
            self._read()
        except SessionError:
            self.file.close()
            raise

    def _read(self) -> None:
        self.attributes = given = self.file.attributes()
        if (given.get("layout"), given.get("layout_version")) != (LAYOUT, LAYOUT_VERSION):
            raise SessionError(f"{self.path} is an HDF5 file, but not a stream beside a session")
        if PREVIOUS_DIGEST not in given:
            raise SessionError(
                f"{self.path} is damaged: its attribute {PREVIOUS_DIGEST} is missing"
            )
        self.type_code = str(given.get("type_code"))
        if self.type_code not in (*TYPE_CODES, TEXT_CODE):
            raise damage(self.path, VALUES, f"is of type {self.type_code}")
        self.channels, self.units = (
            tuple(map(str, parse_json(str(given.get(key)), list, self.path, f"its {key}")))
            for key in ("channels", "units")
        )
        self.layout = stream_layout(self.type_code)
        self._check()
        self.name, self.kind, self.host, self.asked = (
            str(given.get(key, "")) for key in ("name", "kind", "host", "asked")
        )
        self.rate_hz, start_loop_s = (
            value if isinstance(value := given.get(key), float) else 0.0
            for key in ("rate_hz", "start_loop_s")
        )
        self.start = str(given.get("start_utc", "")), start_loop_s
        ends = self.file.rows(END.path)
        self.finished = len(ends) == 1
        self.reason = bytes(ends["reason"][0]).decode(errors="replace") if self.finished else ""
        self.n_rows = self._lengths[MARKERS.path] if self.is_text else self._n_values()
        if self.finished and int(ends["n_rows"][0]) != self.n_rows:
            raise SessionError(f"{self.path} is damaged: some of its last rows are missing")

    def _check(self) -> None:
        width = (len(self.channels),)
        arrays = [
            DataSetSchema(
                array.path,
                1 + array.per_taxel,
                dtype=np.dtype(f"<{array.type_code}"),
                tail=width if array.per_taxel else (),
            )
            for array in self.layout.arrays
        ]
        tables = [
            DataSetSchema(table.path, 1, dtype=table.dtype, tail=())
            for table in self.layout.stored_tables
        ]
        self.file.check([*arrays, *tables, *(text(path) for path, _ in TEXTS)])
        paths = [array.path for array in self.layout.arrays]
        paths += [table.path for table in self.layout.stored_tables]
        self._lengths = {path: readable_rows(self.file, path) for path in paths}

    def _n_values(self) -> int:
        return min(self._lengths[array.path] for array in self.layout.arrays)

    @property
    def is_text(self) -> bool:
        """Whether it has texts, such as markers, and no numbers."""
        return self.type_code == TEXT_CODE

    @property
    def is_growing(self) -> bool:
        """Whether its writer may append to it."""
        return self.file.is_growing

    @property
    def last_digest(self) -> str:
        """The last digest of its rows; empty where a killed writer left none."""
        n_rows = self._lengths[DIGESTS.path]
        if not n_rows:
            return ""
        return bytes(self.file.row(DIGESTS.path, n_rows - 1)["digest"]).decode("ascii", "replace")

    def stored_lengths(self) -> dict[str, int]:
        """Return the rows of each data set that grows, by its path."""
        return dict(self._lengths)

    def stored_rows(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of a data set as stored, text as bytes."""
        return self.file.rows(path, start, stop)

    def values(self, start: int = 0, stop: int | None = None) -> NDArray[Any]:
        """Return rows [start, stop): numbers (n, channels), or texts (n,) of a stream of texts."""
        stop = self.n_rows if stop is None else min(stop, self.n_rows)
        if not self.is_text:
            return self.file.rows(VALUES, start, stop)
        texts = self.file.rows(MARKERS.path, start, stop)["text"]
        return np.array([text.decode(errors="replace") for text in texts], np.str_)

    def lsl_s(self, start: int = 0, stop: int | None = None) -> NDArray[np.float64]:
        """Return the sender's time stamps of rows [start, stop), float64 (n,), s."""
        stop = self.n_rows if stop is None else min(stop, self.n_rows)
        if self.is_text:
            return np.asarray(self.file.rows(MARKERS.path, start, stop)["lsl_s"], np.float64)
        return np.asarray(self.file.rows(STAMPS.path, start, stop), np.float64)

    def times_s(self, start: int = 0, stop: int | None = None) -> NDArray[np.float64]:
        """Return the loop times of rows [start, stop) of the session, float64 (n,), s.

        NaN where the session's clock was never read.
        """
        stamps = self.lsl_s(start, stop)
        clock = self.file.rows(CLOCK.path, 0, self._lengths[CLOCK.path])
        if len(clock):
            at_s = clock["at_s"] - clock["correction_s"]
            stamps = stamps + np.interp(stamps, at_s, clock["correction_s"])
        at_s, ahead_s = self._session_knots()
        if not len(at_s):
            return np.full(len(stamps), np.nan)
        return np.asarray(stamps + np.interp(stamps, at_s, ahead_s))

    def _session_knots(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return LSL times, and how far the loop's clock is ahead there: the earliest readings."""
        rows = self.file.rows(SESSION_CLOCK.path, 0, self._lengths[SESSION_CLOCK.path])
        if not len(rows):
            return np.zeros(0), np.zeros(0)
        ahead_s = rows["loop_s"] - rows["at_s"]
        knots = ((rows["at_s"] - rows["at_s"][0]) / KNOT_S).astype(np.int64)
        order = np.lexsort((-ahead_s, knots))
        earliest = order[np.unique(knots[order], return_index=True)[1]]
        return rows["at_s"][earliest], ahead_s[earliest]

    def describe(self) -> str:
        """Return a sentence on it."""
        rate = f" at {self.rate_hz:g} Hz" if self.rate_hz else ""
        what = "texts" if self.is_text else f"samples of {len(self.channels)} channels{rate}"
        ended = f", {self.reason}" if self.finished else ", not closed"
        return f"{self.path.name}: {self.name} ({self.host}), {self.n_rows:,} {what}{ended}"

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def open_streams(folder: Path) -> Iterator[ExtraStream]:
    """Yield the streams beside a session that can be read; ``rigctl verify`` names the others."""
    for path in stream_paths(folder):
        with suppress(SessionError):
            yield ExtraStream(path)
