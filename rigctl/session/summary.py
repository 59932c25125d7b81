"""Summarise a session as plain values, for people and programs (``rigctl info``), or list many."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.errors import SessionError
from rigctl.experiments import DRUM_EXPERIMENT, EXPERIMENTS
from rigctl.session import layout
from rigctl.session.ground_truth import summarise_truth
from rigctl.session.layout import TableLayout
from rigctl.session.notes import bad_attempts
from rigctl.session.part import existing_parts, stray_files
from rigctl.session.session import Session, describe_ends, ended_early, open_session
from rigctl.session.session_reader import SessionReader, read_closing_digest
from rigctl.session.writer_lock import is_being_written, lock_owner_pid
from rigctl.values import ABOUT, COMPLETE, INCOMPLETE, RECORDING, UNREADABLE, SessionLine, Verdict

BOARD_KIND = "board"
"""Kind of the events with a board's own counts at the start and the end of a sitting."""


def summarise_session(path: Path) -> dict[str, Any]:
    """Return the summary. Raises SessionError for another kind of folder."""
    with open_session(path) as session:
        if isinstance(session, Session):
            return _summarise_drum(session)
        summary: dict[str, Any] = EXPERIMENTS[session.layout.experiment].load("summarise")(session)
        return summary


def _summarise_drum(session: Session) -> dict[str, Any]:
    trials, truth = session.trials, summarise_truth(session)
    return {
        **summarise_header(session),
        **summarise_trials(session),
        "speeds_mm_s": sorted(set(trials["speed_mm_s"].tolist())),
        "forces_g": sorted(set(trials["force_g"].tolist())),
        "mounts": max(trials["mount"].tolist(), default=0),
        **summarise_samples(session),
        "drum_polls": count_rows(session, layout.DRUM),
        "loadcell_samples": count_rows(session, layout.LOADCELL),
        "loadcell_lost": session.loadcell_lost(),
        "events": count_rows(session, layout.EVENTS),
        **summarise_boards(session),
        **({} if truth is None else {"world": truth}),
    }


def count_rows(session: SessionReader, table: TableLayout) -> int:
    """Return the rows of a table in all parts."""
    return sum(part.n_rows(table) for part in session.parts)


def summarise_header(session: SessionReader) -> dict[str, Any]:
    """Return where the session is from, and how far it is written."""
    header = session.header
    writing = is_being_written(session.path)
    boards = session.parts[-1].header.boards
    return {
        "path": str(session.path),
        **({} if header.experiment == DRUM_EXPERIMENT else {"experiment": header.experiment}),
        "layout": f"{layout.LAYOUT} {layout.LAYOUT_VERSION}",
        "protocol": header.protocol,
        "plan_hash": header.plan_hash,
        "seed": header.seed,
        "rig": header.rig,
        "simulated": header.simulated,
        **({"world_file": name} if (name := header.simulation.get("world_file")) else {}),
        **({"cut_by": header.cut_by} if header.cut_by else {}),
        **({"plugins": header.plugin_names} if header.plugins else {}),
        "firmware": {
            b.board: b.firmware_version + (f" ({b.build_hash})" if b.build_hash else "")
            for b in boards
        },
        **{name: getattr(header, name) for name in ABOUT},
        **({"own_fields": header.own} if header.own else {}),
        "start_utc": header.start_utc,
        "software": " ".join(filter(None, (header.software_version, header.software_commit))),
        "parts": len(session.parts),
        "missing": session.describe_missing(),
        "ignored": stray_files(session.path),
        "notes": [f"{note.made_utc} {note.describe()}" for note in session.notes],
        **({"streams": streams} if (streams := [s.describe() for s in session.streams]) else {}),
        "finished": session.finished,
        "closing_digest": read_closing_digest(session.path),
        "written_by": lock_owner_pid(session.path) if writing else None,
        "bytes": sum(part.path.stat().st_size for part in session.parts),
    }


def summarise_boards(session: SessionReader) -> dict[str, Any]:
    """Return the boards' own counts over all sittings; empty without such events."""
    counts: dict[str, list[dict[str, Any]]] = {}
    for event in session.events_of(BOARD_KIND):
        if event.data.get("when") in ("start", "end"):
            counts.setdefault(event.data["board"], []).append(event.data)
    return {"boards": {name: _combine(rows) for name, rows in counts.items()}} if counts else {}


def _combine(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "boot_count": rows[-1]["boot_count"],
        "reset": rows[-1]["reset"],
        "late_ticks": sum(row["late_ticks"] for row in rows),
        "longest_isr_us": max(row["longest_isr_us"] for row in rows),
        "stack_free_percent": min(row["stack_free_percent"] for row in rows),
    }


def summarise_trials(session: SessionReader) -> dict[str, Any]:
    """Return the numbers of trials and attempts, and the plates."""
    trials = session.trials
    committed = len(set(trials["trial_id"][session.committed()].tolist()))
    ended = ended_early(session) if isinstance(session, Session) else {}
    early = {"trials_ended_early": len(ended), "early_ends": describe_ends(ended)}

    def attempts(verdict: Verdict) -> int:
        return int(np.count_nonzero(trials["verdict"] == verdict.value))

    return {
        "trials_planned": session.header.trials_planned,
        "trials_committed": committed,
        **(early if ended else {}),
        "trials_remaining": session.header.trials_planned - committed - len(ended),
        "attempts_rejected": attempts(Verdict.REJECTED),
        "attempts_aborted": attempts(Verdict.ABORTED),
        "textures": sorted(set(trials["texture"].tolist())),
    }


def summarise_samples(session: SessionReader) -> dict[str, Any]:
    """Return the numbers of samples and losses, and the sensor."""
    gaps, header = session.gaps, session.header
    return {
        "samples": session.n_samples,
        "seconds": session.n_samples / header.sample_rate_hz,
        "n_taxels": header.n_taxels,
        "sensor_layout": session.sensor_layout.to_values(),
        "sample_rate_hz": header.sample_rate_hz,
        "gaps": len(gaps),
        "lost_samples": int(gaps["count"].sum()),
    }


MAX_DEPTH = 3
"""Folders below the one that is searched: data, project and day."""


def find_sessions(folder: Path) -> list[Path]:
    """Return the sessions in a folder and below it, the newest first.

    Raises SessionError where the folder cannot be read.
    """
    try:
        found = list(_sessions_in(folder, MAX_DEPTH))
    except OSError as error:
        raise SessionError(
            f"{folder} cannot be read ({error.strerror}): choose the folder that holds the sessions"
        ) from error
    return [path for _, path in sorted(found, key=lambda each: (-each[0], each[1]))]


def _sessions_in(folder: Path, depth: int) -> list[tuple[float, Path]]:
    """Return the sessions with the time of their folders' last change."""
    if existing_parts(folder):
        return [(folder.stat().st_mtime, folder)]
    found = []
    with os.scandir(folder) as entries:
        below = [Path(entry) for entry in entries if entry.is_dir(follow_symlinks=False)]
    for path in below if depth else ():
        if os.access(path, os.R_OK | os.X_OK):  # what others keep to themselves is no session here
            found += _sessions_in(path, depth - 1)
    return found


def read_line(path: Path) -> SessionLine:
    """Return what a list says of a session, from its headers and its table of trials."""
    try:
        with open_session(path) as session:
            return _line_of(session)
    except SessionError as error:
        return SessionLine(str(path), UNREADABLE, str(error))


def _line_of(session: SessionReader) -> SessionLine:
    header, path = session.header, session.path
    stats = [part.path.stat() for part in session.parts]
    modified = datetime.fromtimestamp(max(stat.st_mtime for stat in stats), UTC)
    trials = summarise_trials(session)
    state, reason = _state_of(session, trials["trials_remaining"])
    return SessionLine(
        str(path),
        state,
        reason,
        header.start_utc,
        modified.isoformat(timespec="seconds"),
        header.experiment,
        header.protocol,
        header.operator,
        header.sensor,
        header.plate_lot,
        header.project,
        header.rig,
        header.simulated,
        header.trials_planned,
        trials["trials_committed"],
        len(bad_attempts(session.notes)),
        session.parts[-1].last_digest if session.finished else "",
        sum(stat.st_size for stat in stats),
    )


def _state_of(session: SessionReader, remaining: int) -> tuple[str, str]:
    if is_being_written(session.path):
        return RECORDING, "It is being recorded"
    reasons = session.describe_missing()
    if not session.finished:
        reasons.append("its writer did not close it: recover it")
    if remaining > 0:
        trials = "trial remains" if remaining == 1 else "trials remain"
        reasons.append(f"{remaining} planned {trials}")
    return (INCOMPLETE if reasons else COMPLETE), ". ".join(reasons)
