"""Summarise a session as plain values, for people and programs (``rigctl info``)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.finger.board_messages import VelocitySource
from rigctl.finger.layout import BATCHES, NOT_CLASSIFIED, PREDICTIONS, TRACK, WINDOWS
from rigctl.finger.session import FingerSession, is_finger_session
from rigctl.session import layout
from rigctl.session.ground_truth import summarise_truth
from rigctl.session.layout import TableLayout
from rigctl.session.part import stray_files
from rigctl.session.session import Session, describe_ends, ended_early
from rigctl.session.session_reader import SessionReader, read_closing_digest
from rigctl.session.writer_lock import is_being_written, lock_owner_pid
from rigctl.values import Verdict

BOARD_KIND = "board"
"""Kind of the events with a board's own counts at the start and the end of a sitting."""


def summarise_session(path: Path) -> dict[str, Any]:
    """Return the summary. Raises SessionError for another kind of folder."""
    return _summarise_finger(path) if is_finger_session(path) else _summarise_drum(path)


def _summarise_drum(path: Path) -> dict[str, Any]:
    with Session.open(path) as session:
        trials = session.trials
        summary = {
            "path": str(path),
            **_identity(session),
            **_trials(session),
            "speeds_mm_s": sorted(set(trials["speed_mm_s"].tolist())),
            "forces_g": sorted(set(trials["force_g"].tolist())),
            "mounts": max(trials["mount"].tolist(), default=0),
            **_samples(session),
            "drum_polls": _count_rows(session, layout.DRUM),
            "loadcell_samples": _count_rows(session, layout.LOADCELL),
            "loadcell_lost": session.loadcell_lost(),
            "events": _count_rows(session, layout.EVENTS),
            **_boards(session),
        }
        truth = summarise_truth(session)
    return summary if truth is None else {**summary, "world": truth}


def _summarise_finger(path: Path) -> dict[str, Any]:
    with FingerSession.open(path) as session:
        return {
            "path": str(path),
            "experiment": session.header.experiment,
            **_identity(session),
            "tracker": session.header.tracker.get("name", ""),
            "reference_mm_s": session.header.reference_um_per_s / 1000,
            **_trials(session),
            "profiles": sorted(set(session.trials["profile"].tolist())),
            "committed_by_stage": dict(_count_committed(session)),
            **_answers(session),
            **_samples(session),
            **_scans(session),
            "latency_p99_ms": _latencies(session),
            "events": _count_rows(session, layout.EVENTS),
            **_boards(session),
        }


def _count_committed(session: FingerSession) -> Counter[str]:
    return Counter(session.trials["stage"][session.committed()].tolist())


def _answers(session: FingerSession) -> dict[str, int]:
    """Return the committed trials that were classified, and those that were right."""
    correct = session.trials["correct"][session.committed()]
    classified = int(np.count_nonzero(correct != NOT_CLASSIFIED))
    return {"classified": classified, "right": int(np.count_nonzero(correct == 1))}


def _scans(session: FingerSession) -> dict[str, int]:
    sources = np.concatenate([part.rows(BATCHES)["velocity_source"] for part in session.parts])
    return {
        "positions": _count_rows(session, TRACK),
        "batches": len(sources),
        "batches_without_velocity": int(np.count_nonzero(sources != VelocitySource.RECEIVED)),
        "windows": _count_rows(session, WINDOWS),
        "predictions": _count_rows(session, PREDICTIONS),
    }


def _latencies(session: FingerSession) -> dict[str, float]:
    """Return the 99th percentile of each kind, ms."""
    rows = session.latencies
    return {
        kind: round(float(np.percentile(rows["ms"][rows["kind"] == kind], 99)), 3)
        for kind in sorted(set(rows["kind"].tolist()))
    }


def _count_rows(session: SessionReader, table: TableLayout) -> int:
    return sum(part.n_rows(table) for part in session.parts)


def _identity(session: SessionReader) -> dict[str, Any]:
    header = session.header
    writing = is_being_written(session.path)
    boards = session.parts[-1].header.boards
    return {
        "layout": f"{layout.LAYOUT} {layout.LAYOUT_VERSION}",
        "protocol": header.protocol,
        "plan_hash": header.plan_hash,
        "seed": header.seed,
        "rig": header.rig,
        "simulated": header.simulated,
        **({"world_file": name} if (name := header.simulation.get("world_file")) else {}),
        **({"cut_by": header.cut_by} if header.cut_by else {}),
        "firmware": {b.board: f"{b.firmware_version} ({b.build_hash})" for b in boards},
        "operator": header.operator,
        "sensor": header.sensor,
        "start_utc": header.start_utc,
        "software": " ".join(filter(None, (header.software_version, header.software_commit))),
        "parts": len(session.parts),
        "missing": session.describe_missing(),
        "ignored": stray_files(session.path),
        "notes": [f"{note.made_utc} {note.describe()}" for note in session.notes],
        "finished": session.finished,
        "closing_digest": read_closing_digest(session.path),
        "written_by": lock_owner_pid(session.path) if writing else None,
        "bytes": sum(part.path.stat().st_size for part in session.parts),
    }


def _boards(session: SessionReader) -> dict[str, Any]:
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


def _trials(session: SessionReader) -> dict[str, Any]:
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


def _samples(session: SessionReader) -> dict[str, Any]:
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
