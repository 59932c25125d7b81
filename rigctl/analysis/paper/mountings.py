"""What a classifier learns of how the plates sat: accuracy with the same and another mounting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from rigctl.analysis.features.representations import Representation
from rigctl.analysis.paper.tasks import Curve, TaskResult

DECIMALS = 3
PAIRS = (
    ("trained-mount", "leave-mount-out"),
    ("trained-mount-untrained-speed", "leave-mount-out-untrained-speed"),
)
"""Tasks of the same fits, tested with the trained mountings and with one that was left out."""


class MountingGap(NamedTuple):
    """Mean accuracies, shares, of one representation with ``components`` components.

    ``same``: trials of the mountings that were trained; ``other``: of one that was not.
    ``spread``: standard deviation of the difference over draws (n − 1), None for a single draw.
    """

    task: str
    representation: Representation
    components: int
    same: float
    other: float
    spread: float | None

    @property
    def points(self) -> float:
        """What the plate's own seat contributes, percentage points."""
        return 100 * (self.same - self.other)


def describe_mountings(results: Sequence[TaskResult]) -> list[dict[str, Any]]:
    """Return the gaps as values for JSON, in per cent and percentage points."""
    return [
        {
            "task": gap.task,
            "untrained_speed": gap.task != PAIRS[0][1],
            "representation": gap.representation.key,
            "components": gap.components,
            "same_mounting_percent": round(100 * gap.same, DECIMALS),
            "other_mounting_percent": round(100 * gap.other, DECIMALS),
            "points": round(gap.points, DECIMALS),
            "sd_points": None if gap.spread is None else round(100 * gap.spread, DECIMALS),
        }
        for gap in mounting_gaps(results)
    ]


def mounting_gaps(results: Sequence[TaskResult]) -> list[MountingGap]:
    """Return a gap for each representation in each pair of tasks that was run, in their order."""
    by_key = {result.task.key: result for result in results}
    gaps = []
    for same_key, other_key in PAIRS:
        same, other = by_key.get(same_key), by_key.get(other_key)
        if same is None or other is None:
            continue
        k = min(same.shown_components, other.shown_components)
        for curve in same.curves:
            beside = other.curve(curve.representation.key)
            if beside is not None:
                gaps.append(_gap(other_key, curve, beside, k))
    return gaps


def _gap(task: str, same: Curve, other: Curve, k: int) -> MountingGap:
    """Return the gap between two curves of the same draws, with ``k`` components."""
    by_draw = same.accuracy[:, k - 1] - other.accuracy[:, k - 1]
    spread = float(by_draw.std(ddof=1)) if len(by_draw) > 1 else None
    shares = float(same.mean[k - 1]), float(other.mean[k - 1])
    return MountingGap(task, same.representation, k, *shares, spread)
