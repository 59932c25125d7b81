"""Values to rows of the session's tables and back."""

from __future__ import annotations

import json
from typing import Any

from rigctl.session.format.layout import EVENTS, TRIALS
from rigctl.values import DrumState, Event, LoadcellSample, PlannedTrial, TrialRow, Verdict

REASON_SEPARATOR = "; "
_EVENT_WIDTH = {c.name: int(c.kind[1:]) for c in EVENTS.columns if c.kind.startswith("S")}
_TRIAL_WIDTH = {c.name: int(c.kind[1:]) for c in TRIALS.columns if c.kind.startswith("S")}

Row = tuple[Any, ...]


def clip_text(text: str, width: int) -> bytes:
    """UTF-8 of at most ``width`` bytes; what was cut ends in ``…``, never in half a letter."""
    data = text.encode()
    if len(data) <= width:
        return data
    return data[: width - 3].decode(errors="ignore").encode() + "…".encode()


def drum_row(state: DrumState, force_set_g: float, speed_set_mm_s: float) -> Row:
    """One row of /drum."""
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


def loadcell_row(sample: LoadcellSample) -> Row:
    """One row of /loadcell."""
    return (sample.sequence, sample.board_time_us, sample.raw_counts, sample.force_g)


def event_row(event: Event) -> Row:
    """One row of /events; details too long for it are replaced by a note that says so."""
    data = json.dumps(event.data, ensure_ascii=False, default=str)
    if len(data.encode()) > _EVENT_WIDTH["data"]:
        data = json.dumps({"truncated": True, "length": len(data)})
    return (
        event.at_s,
        clip_text(event.kind, _EVENT_WIDTH["kind"]),
        clip_text(event.text, _EVENT_WIDTH["text"]),
        data.encode(),
    )


def event_of(row: Any) -> Event:
    """The event that a row of /events holds."""
    return Event(
        float(row["at_s"]), _text(row["kind"]), _text(row["text"]), json.loads(_text(row["data"]))
    )


def trial_row(row: TrialRow, part: int, first_sample: int) -> Row:
    """One row of /trials, with the place that the recorder found for it."""
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


def trial_of(row: Any) -> TrialRow:
    """The attempt that a row of /trials holds."""
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
