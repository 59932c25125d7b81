"""Summarise a session of the moving finger as plain values (``rigctl info``)."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from rigctl.finger.board_messages import VelocitySource
from rigctl.finger.layout import BATCHES, NOT_CLASSIFIED, PREDICTIONS, TRACK, WINDOWS
from rigctl.finger.session import FingerSession
from rigctl.session import layout
from rigctl.session.summary import (
    count_rows,
    summarise_boards,
    summarise_header,
    summarise_samples,
    summarise_trials,
)


def summarise_finger(session: FingerSession) -> dict[str, Any]:
    """Return the summary of a session of the moving finger."""
    return {
        **summarise_header(session),
        "tracker": session.header.tracker.get("name", ""),
        "reference_mm_s": session.header.reference_um_per_s / 1000,
        **summarise_trials(session),
        "profiles": sorted(set(session.trials["profile"].tolist())),
        "committed_by_stage": dict(_count_committed(session)),
        **_answers(session),
        **summarise_samples(session),
        **_scans(session),
        "latency_p99_ms": _latencies(session),
        "events": count_rows(session, layout.EVENTS),
        **summarise_boards(session),
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
        "positions": count_rows(session, TRACK),
        "batches": len(sources),
        "batches_without_velocity": int(np.count_nonzero(sources != VelocitySource.RECEIVED)),
        "windows": count_rows(session, WINDOWS),
        "predictions": count_rows(session, PREDICTIONS),
    }


def _latencies(session: FingerSession) -> dict[str, float]:
    """Return the 99th percentile of each kind, ms."""
    rows = session.latencies
    return {
        kind: round(float(np.percentile(rows["ms"][rows["kind"] == kind], 99)), 3)
        for kind in sorted(set(rows["kind"].tolist()))
    }
