"""Encode values as rows of the session's tables and parse them back."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from operator import attrgetter
from typing import Any

from rigctl.session.format.layout import EVENTS, TRIALS, Column
from rigctl.values import DrumState, Event, PlannedTrial, TrialRow, Verdict

REASON_SEPARATOR = "; "
_EVENT_WIDTH = {column.name: column.text_bytes for column in EVENTS.columns}
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
    return (
        state.at_s,
        state.board_time_us,
        state.state,
        state.fault,
        state.fault_bits,
        state.status_bits,
        state.steps,
        state.angle_deg,
        state.speed_mm_s,
        speed_set_mm_s,
        state.force_g,
        force_set_g,
        state.actuator_position_um,
        state.actuator_drive_permille,
        state.sync_count,
        state.sync_rise_us,
        state.sync_fall_us,
        state.index_count,
        state.loadcell_lost,
    )


def event_row(event: Event) -> Row:
    """Return one row of /events; a note replaces ``data`` that does not fit."""
    data = json.dumps(event.data, ensure_ascii=False, default=str)
    if len(data.encode()) > _EVENT_WIDTH["data"]:
        data = json.dumps({"truncated": True, "length": len(data)})
    return (
        event.at_s,
        clip_text(event.kind, _EVENT_WIDTH["kind"]),
        clip_text(event.text, _EVENT_WIDTH["text"]),
        data.encode(),
    )


def parse_event(row: Any) -> Event:
    """Return the event in a row of /events."""
    return Event(
        float(row["at_s"]), str(row["kind"]), str(row["text"]), json.loads(str(row["data"]))
    )


def trial_row(row: TrialRow, part: int, first_sample: int) -> Row:
    """Return one row of /trials; the writer supplies ``part`` and ``first_sample``."""
    stored = replace(row, part=part, first_sample=first_sample)
    return tuple(map(_encode, _trial_values(stored), TRIALS.columns))


def parse_trial(row: Any) -> TrialRow:
    """Return the attempt in a row of /trials, text as Unicode."""
    values: dict[str, Any] = dict(zip(row.dtype.names, row.item(), strict=True))
    trial = PlannedTrial(**{name: values.pop(name) for name in _PLANNED})
    reasons = values.pop("reasons")
    values["reasons"] = tuple(reasons.split(REASON_SEPARATOR)) if reasons else ()
    values["verdict"] = Verdict(values["verdict"])
    return TrialRow(trial=trial, **values)


def _encode(value: Any, column: Column) -> Any:
    if not column.text_bytes:
        return value
    text = REASON_SEPARATOR.join(value) if isinstance(value, tuple) else value
    return clip_text(text, column.text_bytes)
