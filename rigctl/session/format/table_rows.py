"""Encode values as rows of the session's tables and parse them back."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from rigctl.session.format.data_sets import Column, TableLayout
from rigctl.session.format.layout import DRUM, EVENTS, TRIALS
from rigctl.session.hdf5_file import parse_json
from rigctl.values import DrumState, Event, PlannedTrial, TrialRow, Verdict

REASON_SEPARATOR = "; "
_DRUM = [column.name for column in DRUM.columns]
_SPEED_SET, _FORCE_SET = _DRUM.index("speed_set_mm_s"), _DRUM.index("force_set_g")
_drum_values = attrgetter(*(name for name in _DRUM if "_set_" not in name))
_PLANNED = tuple(field.name for field in fields(PlannedTrial))
_trial_values = attrgetter(
    *(f"trial.{name}" if name in _PLANNED else name for name in TRIALS.dtype.names or ())
)

Row = tuple[Any, ...]


def clip_text(text: str, width: int) -> bytes:
    """Return UTF-8 of at most ``width`` bytes; a cut text ends in ``…``, never in half a letter."""
    data = text.encode()
    if len(data) <= width:
        return data
    return data[: width - 3].decode(errors="ignore").encode() + "…".encode()


def drum_row(state: DrumState, force_set_g: float, speed_set_mm_s: float) -> Row:
    """Return one row of /drum."""
    values = list(_drum_values(state))
    values.insert(_SPEED_SET, speed_set_mm_s)
    values.insert(_FORCE_SET, force_set_g)
    return tuple(values)


def event_row(event: Event) -> Row:
    """Return one row of /events; a note replaces ``data`` that does not fit."""
    data = json.dumps(event.data, ensure_ascii=False, default=str)
    if len(data.encode()) > EVENTS.columns[-1].text_bytes:
        data = json.dumps({"truncated": True, "length": len(data)})
    return encode_row((event.at_s, event.kind, event.text, data), EVENTS)


def parse_event(row: Any, path: Path) -> Event:
    """Return the event in a row of /events of the part at ``path``.

    Raises SessionError that names part and place if the row's data are no JSON object.
    """
    at_s = float(row["at_s"])
    data = parse_json(str(row["data"]), dict, path, f"the event at {at_s:g} s in /events")
    return Event(at_s, str(row["kind"]), str(row["text"]), data)


def trial_row(row: TrialRow, part: int, first_sample: int) -> Row:
    """Return one row of /trials; the writer supplies ``part`` and ``first_sample``."""
    stored = replace(row, part=part, first_sample=first_sample)
    return encode_row(_trial_values(stored), TRIALS)


def parse_trial(row: Any) -> TrialRow:
    """Return the attempt in a row of /trials, text as Unicode."""
    values: dict[str, Any] = dict(zip(row.dtype.names, row.item(), strict=True))
    trial = PlannedTrial(**{name: values.pop(name) for name in _PLANNED})
    return TrialRow(trial=trial, **parse_verdict(values))


def parse_verdict(values: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of an attempt with its verdict and reasons as values."""
    reasons = values["reasons"]
    parsed = tuple(reasons.split(REASON_SEPARATOR)) if reasons else ()
    return {**values, "verdict": Verdict(values["verdict"]), "reasons": parsed}


def encode_row(values: Iterable[Any], table: TableLayout) -> Row:
    """Return values as a row of a table; text is cut to its column's length."""
    return tuple(map(_encode, values, table.columns))


def _encode(value: Any, column: Column) -> Any:
    if not column.text_bytes:
        return value
    text = REASON_SEPARATOR.join(value) if isinstance(value, tuple) else value
    return clip_text(text, column.text_bytes)
