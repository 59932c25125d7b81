"""Show the scans, time and disk space of a protocol of the moving finger."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from rigctl.protocol.finger import Stage
from rigctl.protocol.finger_plan import FingerPlan


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
