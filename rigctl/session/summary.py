"""What a session is and holds, as plain values for people and programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.session.files.ground_truth import summary
from rigctl.session.format import layout
from rigctl.session.format.writer_lock import is_being_written, lock_owner
from rigctl.session.read.session import Session
from rigctl.values import BoardIdentity, Verdict

BOARD_KIND = "board"
"""Kind of the events in which a board says how it is at the start and the end of a sitting."""


def info(path: Path) -> dict[str, Any]:
    """Describe a session. Raises SessionError for a folder that is none."""
    with Session.open(path) as session:
        answer = {
            "path": str(path),
            **_identity(session),
            **_trials(session),
            **_counts(session),
            **_boards(session),
        }
        world = summary(session)
    return answer if world is None else {**answer, "world": world}


def firmware(board: BoardIdentity) -> str:
    """A board's firmware for people: version and build."""
    return f"{board.firmware_version} ({board.build_hash})"


def _identity(session: Session) -> dict[str, Any]:
    header = session.header
    writing = is_being_written(session.path)
    return {
        "layout": f"{layout.LAYOUT} {layout.LAYOUT_VERSION}",
        "protocol": header.protocol,
        "plan_hash": header.plan_hash,
        "seed": header.seed,
        "rig": header.rig,
        "simulated": header.simulated,
        **({"world_file": name} if (name := header.simulation.get("world_file")) else {}),
        **({"cut_by": header.cut_by} if header.cut_by else {}),
        "firmware": {board.board: firmware(board) for board in session.parts[-1].header.boards},
        "operator": header.operator,
        "sensor": header.sensor,
        "start_utc": header.start_utc,
        "software": " ".join(filter(None, (header.software_version, header.software_commit))),
        "parts": len(session.parts),
        "finished": session.finished,
        "written_by": lock_owner(session.path) if writing else None,
        "bytes": sum(part.path.stat().st_size for part in session.parts),
    }


def _boards(session: Session) -> dict[str, Any]:
    """What the boards counted of themselves over all sittings; nothing where none is told."""
    told: dict[str, list[dict[str, Any]]] = {}
    for event in session.events_of(BOARD_KIND):
        if event.data.get("when") in ("start", "end"):
            told.setdefault(event.data["board"], []).append(event.data)
    return {"boards": {name: _counted(rows) for name, rows in told.items()}} if told else {}


def _counted(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "boot_count": rows[-1]["boot_count"],
        "reset": rows[-1]["reset"],
        "late_ticks": sum(row["late_ticks"] for row in rows),
        "longest_isr_us": max(row["longest_isr_us"] for row in rows),
        "stack_free_percent": min(row["stack_free_percent"] for row in rows),
    }


def _trials(session: Session) -> dict[str, Any]:
    trials = session.trials
    committed = len(set(trials["trial_id"][session.committed()].tolist()))

    def attempts(verdict: Verdict) -> int:
        return int(np.count_nonzero(trials["verdict"] == verdict.value))

    return {
        "trials_planned": session.header.trials_planned,
        "trials_committed": committed,
        "trials_remaining": session.header.trials_planned - committed,
        "attempts_rejected": attempts(Verdict.REJECTED),
        "attempts_aborted": attempts(Verdict.ABORTED),
        "textures": sorted(set(trials["texture"].tolist())),
        "speeds_mm_s": sorted(set(trials["speed_mm_s"].tolist())),
        "forces_g": sorted(set(trials["force_g"].tolist())),
    }


def _counts(session: Session) -> dict[str, Any]:
    gaps, header = session.gaps, session.header
    return {
        "samples": session.n_samples,
        "seconds": session.n_samples / header.sample_rate_hz,
        "n_taxels": header.n_taxels,
        "sample_rate_hz": header.sample_rate_hz,
        "gaps": len(gaps),
        "lost_samples": int(gaps["count"].sum()),
        "drum_polls": sum(part.n_rows(layout.DRUM) for part in session.parts),
        "loadcell_samples": sum(part.n_rows(layout.LOADCELL) for part in session.parts),
        "loadcell_lost": session.loadcell_lost(),
        "events": sum(part.n_rows(layout.EVENTS) for part in session.parts),
    }
