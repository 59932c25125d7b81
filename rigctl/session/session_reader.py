"""Read a session of any layout: join its parts, also while a writer appends to it.

A part that cannot be read takes its own trials with it, and nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session import layout
from rigctl.session.extra_stream import ExtraStream, open_streams
from rigctl.session.header import SessionHeader
from rigctl.session.layout import (
    SessionLayout,
    SessionOutcome,
    TableLayout,
    parse_event,
    part_name,
    part_number,
)
from rigctl.session.notes import Mark, bad_attempts, damaged_notes, read_notes
from rigctl.session.part import (
    PartReader,
    StructuredArray,
    check_experiment,
    existing_parts,
    part_paths,
)
from rigctl.session.sample_index import SAMPLES, locate_windows
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.writer_lock import is_being_written
from rigctl.values import Event, Verdict


@dataclass(frozen=True, slots=True)
class MissingPart:
    """A part whose rows are left out; ``reason`` continues a sentence that its name begins."""

    name: str
    reason: str

    @property
    def sentence(self) -> str:
        """What is wrong with the part, and what that means."""
        return f"{self.name} {self.reason}; its trials are left out"


MOST_OPEN = 32
"""HDF5 takes a megabyte for each open part, and looks through all that is open for each part that
closes; a session of a week has hundreds."""


def open_parts(paths: Sequence[Path]) -> tuple[list[PartReader], dict[int, str]]:
    """Open the parts that can be read; return them and the reason for each other one by number.

    All stay open, or only the last one of more than ``MOST_OPEN``. Of parts of several sessions,
    those of the most frequent plan are read.
    """
    parts: list[PartReader] = []
    damaged: dict[int, str] = {}
    n_open = MOST_OPEN if len(paths) <= MOST_OPEN else 1
    for path in paths:
        try:
            parts.append(PartReader(path))
        except SessionError as error:
            damaged[part_number(path)] = _reason(path, error)
        for part in parts[-1 - n_open : -n_open]:
            part.close()
    for part, reason in _foreign(parts):
        part.close()
        parts.remove(part)
        damaged[part.number] = reason
    return parts, damaged


def find_missing(
    folder: Path,
    parts: Sequence[PartReader],
    damaged: Mapping[int, str],
) -> tuple[MissingPart, ...]:
    """Return the parts that are missing beside the readable ``parts``, in their order.

    ``damaged``: reasons of those that exist and cannot be read.
    """
    present = {part.number for part in parts}
    reasons = dict.fromkeys(range(1, max(present | damaged.keys(), default=0)), "is missing")
    if not is_being_written(folder):  # else its writer may be about to begin the next part
        reasons |= _announced(parts)
    reasons |= damaged
    return tuple(MissingPart(part_name(n), reasons[n]) for n in sorted(reasons.keys() - present))


def highest_number(folder: Path) -> int:
    """Return the highest number that a part of this session has or had; 0 without any.

    No later part may take the number of one that is damaged, or that the last one announces.
    """
    paths = existing_parts(folder)
    parts, _ = open_parts(paths[-1:])
    numbers = [*map(part_number, paths), *_announced(parts)]
    for part in parts:
        part.close()
    return max(numbers, default=0)


def _reason(path: Path, error: SessionError) -> str:
    """Return the error without the file's path, which the part's name replaces."""
    text = str(error)
    return text.removeprefix(f"{path} ") if text.startswith(f"{path} ") else f"is damaged: {text}"


def _foreign(parts: Sequence[PartReader]) -> list[tuple[PartReader, str]]:
    """Return the parts that were recorded under another number or for another plan."""
    found = []
    for part in parts:
        number = part.attributes.get("part")
        if number != part.number:
            found.append((part, f"claims to be part {number}: it is a copy or was renamed"))
    plans = Counter(_plan(part) for part in parts)
    if len(plans) > 1:
        (common, _), *_ = plans.most_common(1)
        moved = {id(part) for part, _ in found}
        found += [
            (part, "belongs to a session of another plan or sensor")
            for part in parts
            if _plan(part) != common and id(part) not in moved
        ]
    return found


def _plan(part: PartReader) -> tuple[str, str, int]:
    return part.layout.experiment, part.header.plan_hash, part.header.n_taxels


def _announced(parts: Sequence[PartReader]) -> dict[int, str]:
    """Return the part that the last one says to have been followed by, if it is newer than that."""
    if not parts or not parts[-1].finished:
        return {}
    last = parts[-1]
    if len(last.rows_where(layout.EVENTS, "kind", layout.SESSION_END_KIND)):
        return {}
    if layout.begun_path(last.path.with_name(part_name(last.number + 1))).exists():
        return {}  # its writer was killed, or the disk refused, before there was anything to miss
    return {last.number + 1: f"is missing, {last.path.name} says that another part followed it"}


def read_closing_digest(folder: Path) -> str:
    """Return the last digest of a session; empty if its last part is not closed or not readable.

    Raises SessionError for another kind of folder.
    """
    path = max(part_paths(folder), key=layout.part_number)
    try:
        part = PartReader(path)
    except SessionError:
        return ""
    try:
        return part.last_digest if part.finished else ""
    finally:
        part.close()


def session_end(part: PartReader) -> Mapping[str, object] | None:
    """Return how the sitting ended, if the part is the last one of it.

    Raises SessionError for an event that no recording wrote.
    """
    rows = part.rows_where(layout.EVENTS, "kind", layout.SESSION_END_KIND)
    if not len(rows):
        return None
    data = parse_event(rows[-1], part.path).data
    if data.get("outcome") not in list(SessionOutcome):
        raise SessionError(f"{part.path}: its event session_end has no outcome")
    return data


QUARANTINE_KIND = "quarantine"
"""Kind of the event of a committed attempt that is unusual on its data."""
NOTE_KIND = "note"
"""Kind of the event with a note that was written while samples were recorded."""
CUT_SHORT = "the file ends before their samples do"
MAX_LISTED = 20


class SessionReader:
    """Reader of a session's folder. Close it, or use it in a ``with`` block.

    ``missing_parts``: parts that a session had and that cannot be read. ``left_out``: the reason
    for each attempt that does not count, by its index in ``trials``, because its samples cannot be
    read or were altered, or because a note marks it bad; :meth:`describe_missing` names both.
    ``notes``: those that people added.

    ``trials`` is one structured array over all parts, text as Unicode: one row for each attempt in
    the order in which they ended. ``docs/reference/session.md`` lists the columns; every method
    takes an index into it for a trial. A reader of an experiment adds its layout and its values.
    """

    layout: ClassVar[SessionLayout]

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parts: list[PartReader] = []
        self._damaged: dict[int, str] = {}
        self._streams: tuple[ExtraStream, ...] | None = None
        try:
            self._open_parts(part_paths(path))
            self._load()
        except SessionError:
            self.close()
            raise

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a session; :attr:`missing_parts` are left out.

        Raises SessionError if no part can be read, and for another experiment or kind of folder.
        """
        return cls(path)

    def close(self) -> None:
        """Close the files of all parts and streams."""
        for part in self.parts:
            part.leave()  # h5py looks through all that is open, of all files, for each that closes
        for part in self.parts:
            part.close()
        self._close_streams()

    def _close_streams(self) -> None:
        for stream in self._streams or ():
            stream.close()
        self._streams = None

    @property
    def streams(self) -> tuple[ExtraStream, ...]:
        """Streams of other programs beside the session, those that can be read, in their order."""
        if self._streams is None:
            self._streams = tuple(open_streams(self.path))
        return self._streams

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def refresh(self) -> None:
        """Update to the last flush: new rows, new parts and streams."""
        self._close_streams()
        last, paths = self.parts[-1], part_paths(self.path)
        last.refresh()  # after the list: a part that another follows does not grow
        self._open_parts([path for path in paths if part_number(path) > last.number])
        self._load()

    def describe_missing(self) -> list[str]:
        """Return a sentence for each missing part and for trials that are left out of others."""
        lines = [part.sentence for part in self.missing_parts[:MAX_LISTED]]
        if len(self.missing_parts) > MAX_LISTED:
            lines.append(f"{len(self.missing_parts) - MAX_LISTED} more parts are missing")
        lines += [line for part in self.parts for line in part.describe_cut()]
        lines += damaged_notes(self.path)
        return lines + self._describe(
            self.left_out.keys() - self.repeated, "is left out", "are left out"
        )

    def describe_repeated(self) -> list[str]:
        """Return a sentence for each group of trials that do not count and were repeated."""
        return self._describe(self.left_out.keys() & self.repeated, "was repeated", "were repeated")

    def _describe(self, rows: Iterable[int], one: str, many: str) -> list[str]:
        """Return a sentence for the trials of each part and reason; ``one``, ``many``: the verb."""
        by_reason: dict[tuple[int, str], list[int]] = {}
        for index in sorted(rows):
            row, reason = self.trials[index], self.left_out[index]
            by_reason.setdefault((int(row["part"]), reason), []).append(int(row["trial_id"]))
        return [
            f"{part_name(part)}: trial {_list_ids(ids)} {one}: {reason}"
            if len(ids) == 1
            else f"{part_name(part)}: {len(ids)} trials {many} ({_list_ids(ids)}): {reason}"
            for (part, reason), ids in sorted(by_reason.items())
        ]

    def leave_out(self, reasons: Mapping[int, str]) -> None:
        """Leave out further trials, by their index, with the reason that a sentence ends with."""
        self.left_out |= dict(reasons)

    @property
    def header(self) -> SessionHeader:
        """Metadata of the first part that can be read; each of ``parts`` has its own."""
        return self.parts[0].header

    @property
    def sensor_layout(self) -> SensorLayout:
        """Rows, columns and layers of the sensor; an older part has the default of its taxels."""
        return self.header.sensor_layout or SensorLayout.default(self.header.n_taxels)

    @property
    def protocol_text(self) -> str:
        """Protocol of the session, TOML."""
        return self.parts[0].text("/protocol_toml")

    @property
    def rig_text(self) -> str:
        """Description of the rig at the last start, TOML."""
        return self.parts[-1].text("/rig_toml")

    @property
    def finished(self) -> bool:
        """Whether the writer closed the last part, and that part is there."""
        missing = [part_number(Path(part.name)) for part in self.missing_parts]
        return self.parts[-1].finished and max(missing, default=0) < self.parts[-1].number

    @property
    def n_samples(self) -> int:
        """Number of samples in all parts."""
        return sum(part.n_samples for part in self.parts)

    @property
    def gaps(self) -> StructuredArray:
        """All gaps, with the number of their ``part``."""
        return self._join(layout.GAPS)

    @property
    def events(self) -> tuple[Event, ...]:
        """Events of all parts."""
        return self._parse_events(self._join(layout.EVENTS))

    def events_of(self, kind: str) -> tuple[Event, ...]:
        """Return the events of one kind."""
        parts = [(p.number, p.rows_where(layout.EVENTS, "kind", kind)) for p in self.parts]
        return self._parse_events(_joined(parts))

    def _parse_events(self, rows: StructuredArray) -> tuple[Event, ...]:
        names = map(part_name, rows["part"].tolist())
        return tuple(parse_event(r, self.path / name) for r, name in zip(rows, names, strict=True))

    def committed(self) -> NDArray[np.int64]:
        """Return the indices of the committed trials, int64, in the order of trial ids.

        Trials that are :attr:`left_out` are not among them.
        """
        committed = self.trials["verdict"] == Verdict.COMMITTED.value
        committed[list(self.left_out)] = False
        indices = np.flatnonzero(committed)
        order = np.argsort(self.trials["trial_id"][indices], kind="stable")
        return indices[order].astype(np.int64)

    def quarantined(self) -> dict[int, str]:
        """Return why committed attempts are in quarantine, by index; not those marked good."""
        released = {(n.trial_id, n.attempt) for n in self.notes if n.mark is Mark.GOOD}
        why = {
            (event.data.get("trial_id"), event.data.get("attempt")): event.text
            for event in self.events_of(QUARANTINE_KIND)
        }
        attempts = zip(
            self.trials["trial_id"].tolist(), self.trials["attempt"].tolist(), strict=True
        )
        return {
            index: why[one]
            for index, one in enumerate(attempts)
            if one in why and one not in released
        }

    @property
    def repeated(self) -> frozenset[int]:
        """The attempts that do not count while another one at their trial does, by index."""
        counted = self.committed()
        others = np.isin(self.trials["trial_id"], self.trials["trial_id"][counted])
        others[counted] = False
        return frozenset(np.flatnonzero(others).tolist())

    def trial_notes(self) -> dict[int, str]:
        """Return what people noted on attempts, by index; also notes written during one."""
        found: dict[int, list[str]] = {}
        for note in self.notes:
            is_about = self.trials["trial_id"] == note.trial_id
            for index in np.flatnonzero(is_about & (self.trials["attempt"] == note.attempt)):
                found.setdefault(int(index), []).append(note.remark)
        for event in self.events_of(NOTE_KIND):
            is_during = self.trials["started_s"] <= event.at_s
            for index in np.flatnonzero(is_during & (event.at_s <= self.trials["ended_s"])):
                if not event.data.get("trial_id"):
                    found.setdefault(int(index), []).append(event.text)
        return {index: "; ".join(texts) for index, texts in found.items()}

    def samples(self, index: int, first: int = 0, end: int | None = None) -> NDArray[np.uint16]:
        """Return the readings of a trial, uint16 (n, n_taxels); :meth:`window` has the gaps.

        ``first``, ``end``: read only the rows ``first`` … ``end - 1`` of them.
        """
        part, start, stop = self._rows_of(index)
        stop = stop if end is None else min(stop, start + end)
        return part.read(SAMPLES, min(start + first, stop), stop)

    def sample_count(self, index: int) -> int:
        """Return the number of readings of a trial that were received."""
        _, start, stop = self._rows_of(index)
        return stop - start

    def _part(self, number: int) -> PartReader:
        return next(part for part in self.parts if part.number == number)

    def _rows_of(self, index: int) -> tuple[PartReader, int, int]:
        """Return the part and the rows [start, stop) of a trial's window."""
        row = self.trials[[index]]
        part = self._part(int(row["part"][0]))
        (window,) = locate_windows(part, row, 0)
        return part, window.start, window.stop

    def _open_parts(self, paths: Sequence[Path]) -> None:
        parts, damaged = open_parts(paths)
        self.parts += parts
        self._damaged |= damaged
        for part in parts:
            self._damaged.pop(part.number, None)
        if not self.parts:
            name, reason = min((part_name(n), reason) for n, reason in damaged.items())
            raise SessionError(f"{self.path / name} {reason}")
        if self.parts[0].layout is not self.layout:
            self.close()
            check_experiment(self.path, self.parts[0].layout, self.layout)

    def _load(self) -> None:
        """Read the trials, and find what is missing."""
        self.missing_parts = find_missing(self.path, self.parts, self._damaged)
        found = []
        self.left_out: dict[int, str] = {}
        n_rows = 0
        for part in self.parts:
            rows, left_out = _trials_of(part)
            found.append((part.number, rows))
            self.left_out |= {n_rows + row: reason for row, reason in left_out.items()}
            n_rows += len(rows)
        self.trials = _joined(found)
        self.notes = read_notes(self.path)
        self._leave_out_bad()

    def _leave_out_bad(self) -> None:
        """Leave out the committed attempts that a person marked bad."""
        for (trial_id, attempt), note in bad_attempts(self.notes).items():
            rows = (self.trials["trial_id"] == trial_id) & (self.trials["attempt"] == attempt)
            rows &= self.trials["verdict"] == Verdict.COMMITTED.value
            for index in np.flatnonzero(rows).tolist():
                self.left_out.setdefault(index, f"marked bad: {note.text}")

    def _join(self, table: TableLayout) -> StructuredArray:
        return _joined([(part.number, part.rows(table)) for part in self.parts])


def _trials_of(part: PartReader) -> tuple[StructuredArray, dict[int, str]]:
    """Return a part's attempts, and why some of them are left out."""
    stored = part.attempts()
    rows = stored[np.isin(stored["verdict"], list(Verdict))]  # without rows that a crash left empty
    rows["part"] = part.number
    left_out = dict.fromkeys(_cut_trials(part, rows).tolist(), CUT_SHORT)
    return rows, left_out


def _cut_trials(part: PartReader, rows: StructuredArray) -> NDArray[np.intp]:
    """Return which trials have samples beyond the end of a part that was cut short."""
    if not part.cut_rows.keys() & part.lengths().keys():
        return np.zeros(0, np.intp)
    beyond = rows["first_sample"] + rows["count"] > part.n_samples
    return np.flatnonzero(beyond & (rows["first_sample"] >= 0))


def _list_ids(ids: Sequence[int]) -> str:
    listed = ", ".join(map(str, ids[:MAX_LISTED]))
    return f"{listed} …" if len(ids) > MAX_LISTED else listed


def _joined(parts: Sequence[tuple[int, StructuredArray]]) -> StructuredArray:
    """Return the rows of a table in all parts, with the number of each row's part."""
    rows: StructuredArray = np.concatenate([rows for _, rows in parts])
    names = rows.dtype.names or ()
    if "part" in names:
        return rows
    joined: StructuredArray = np.empty(rows.shape, [("part", "i2"), *rows.dtype.descr])
    joined["part"] = np.repeat([number for number, _ in parts], [len(r) for _, r in parts])
    for name in names:
        joined[name] = rows[name]
    return joined
