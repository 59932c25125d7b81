"""Encode values as rows of the session's tables and parse them back."""

from __future__ import annotations

import json
from typing import Any

from rigctl.session.format.layout import EVENTS, TRIALS
from rigctl.values import DrumState, Event, PlannedTrial, TrialRow, Verdict

REASON_SEPARATOR = "; "
_EVENT_WIDTH = {column.name: column.text_bytes for column in EVENTS.columns}
_TRIAL_WIDTH = {column.name: column.text_bytes for column in TRIALS.columns}

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
        float(row["at_s"]), _text(row["kind"]), _text(row["text"]), json.loads(_text(row["data"]))
    )


def trial_row(row: TrialRow, part: int, first_sample: int) -> Row:
    """Return one row of /trials; the writer supplies ``part`` and ``first_sample``."""
    trial = row.trial
    return (
        trial.trial_id,
        row.attempt,
        part,
        clip_text(trial.texture, _TRIAL_WIDTH["texture"]),
        trial.speed_mm_s,
        trial.force_g,
        trial.repeat,
        trial.travel_mm,
        trial.force_mode.encode(),
        trial.direction.encode(),
        trial.depth_mm,
        row.first_counter,
        first_sample,
        row.count,
        row.verdict.value.encode(),
        clip_text(REASON_SEPARATOR.join(row.reasons), _TRIAL_WIDTH["reasons"]),
        row.started_s,
        row.ended_s,
        row.mean_speed_mm_s,
        row.mean_force_g,
    )


def parse_trial(row: Any) -> TrialRow:
    """Return the attempt in a row of /trials."""
    reasons = _text(row["reasons"])
    return TrialRow(
        trial=PlannedTrial(
            int(row["trial_id"]),
            _text(row["texture"]),
            float(row["speed_mm_s"]),
            float(row["force_g"]),
            int(row["repeat"]),
            float(row["travel_mm"]),
            _text(row["force_mode"]),
            _text(row["direction"]),
            float(row["depth_mm"]),
        ),
        attempt=int(row["attempt"]),
        part=int(row["part"]),
        first_counter=int(row["first_counter"]),
        first_sample=int(row["first_sample"]),
        count=int(row["count"]),
        verdict=Verdict(_text(row["verdict"])),
        reasons=tuple(reasons.split(REASON_SEPARATOR)) if reasons else (),
        started_s=float(row["started_s"]),
        ended_s=float(row["ended_s"]),
        mean_speed_mm_s=float(row["mean_speed_mm_s"]),
        mean_force_g=float(row["mean_force_g"]),
    )


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
