"""Show the scans, plate changes, time and disk space of a protocol of the moving finger."""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from typing import Any

from rigctl.cli.check import SIMULATED, in_columns, order_text, size_text, time_text, title_text
from rigctl.finger.config import load_finger_config
from rigctl.finger.plan import FingerPlan, load_finger_protocol
from rigctl.finger.values import Stage
from rigctl.protocol.plan import PLATE_BY_PLATE


def check_protocol(path: Path, args: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Return the summary of a protocol as plain values and as a table, for ``rigctl check``."""
    if args.rig not in SIMULATED:
        load_finger_config(Path(args.rig))
    summary = describe_finger(load_finger_protocol(path).plan(list(Stage), args.seed))
    return summary, finger_table(summary)


def describe_finger(plan: FingerPlan) -> dict[str, Any]:
    """Return the summary of a plan of all stages as plain values.

    ``seconds`` are those of the scans and the ways back, without changes of plates.
    """
    protocol = plan.protocol
    return {
        "protocol": protocol.name,
        "description": protocol.description,
        "textures": list(protocol.textures),
        "profiles": [profile.value for profile in protocol.profiles],
        "reference_mm_s": protocol.reference_mm_s,
        "order": protocol.order,
        "seed": plan.seed,
        "stages": {stage.value: _stage(plan, stage) for stage in Stage},
        "trials": len(plan.trials),
        "plate_changes": _plate_changes(plan),
        "seconds": plan.duration_s,
        "bytes": plan.bytes_estimate,
        "hash": plan.hash,
    }


def _stage(plan: FingerPlan, stage: Stage) -> dict[str, Any]:
    part = plan.protocol.plan([stage], plan.seed)
    return {
        "trials": len(part.trials),
        "plate_changes": _plate_changes(part),
        "seconds": part.duration_s,
        "bytes": part.bytes_estimate,
    }


def _plate_changes(plan: FingerPlan) -> int:
    """Return how often a person lays a plate down, the first one included."""
    changes = sum(before.texture != after.texture for before, after in pairwise(plan.trials))
    return changes + bool(plan.trials)


def finger_table(summary: dict[str, Any]) -> str:
    """Return the summary of a protocol of the moving finger as a table of two columns."""
    stages: list[tuple[str, str]] = [
        (name, f"{stage['trials']} scans, {_needs(stage)}")
        for name, stage in summary["stages"].items()
    ]
    rows: list[tuple[str, str]] = [
        ("protocol", title_text(summary)),
        ("plates", " ".join(summary["textures"])),
        ("profiles", " ".join(summary["profiles"])),
        ("reference", f"{summary['reference_mm_s']:g} mm/s"),
        ("order", order_text(summary, PLATE_BY_PLATE)),
        *stages,
        ("all", f"{summary['trials']} scans, {_needs(summary)}"),
        ("plan", summary["hash"]),
        ("record it with", "rigctl realtime train, calibrate, run"),
    ]
    return in_columns(rows)


def _needs(part: dict[str, Any]) -> str:
    changes = f"{part['plate_changes']} changes of plates"
    return f"{time_text(part['seconds'])} and {changes}, {size_text(part['bytes'])}"
