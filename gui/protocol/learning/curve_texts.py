"""What the learning curve says in words and numbers. This module does not import Qt."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gui.analysis.export.value_file import yes_or_no

if TYPE_CHECKING:
    from rigctl.analysis.learning.learning_curve import CurvePoint
    from rigctl.analysis.learning.session_curve import SessionCurve

INTERVAL = (
    "Bars: 95 % Wilson interval at a fixed number of trials, of plates as they are mounted now; on "
    "virtual data it held the accuracy in 94 to 98 % of cases"
)
VALUE_NAMES = (
    "trials of each plate and condition",
    "plates",
    "conditions (speed × force)",
    "trials to train on, fewest of a fold",
    "trials tested",
    "trials named right",
    "accuracy (%)",
    "interval low (%)",
    "interval high (%)",
    "chance (%)",
    "simulated",
)


def heading(curve: SessionCurve) -> str:
    """Return the newest accuracy with its interval, or why there is none."""
    simulated = "SIMULATED. " if curve.simulated else ""
    if not curve.points:
        return simulated + curve.shortfall
    point = curve.points[-1]
    return (
        f"{simulated}{_percent(point.accuracy)} of {point.tested} held-out trials named right "
        f"({_interval(point)}), chance {_percent(point.chance)}; {len(point.plates)} plates, "
        f"{point.n_trials} of each at {_conditions(point)}; {curve.trials} trials so far."
    )


def point_text(point: CurvePoint) -> str:
    """Return the values of one point, for the pointer."""
    return (
        f"{point.n_trials} of each: {_percent(point.accuracy)} ({_interval(point)}), "
        f"{point.right} of {point.tested} right, {len(point.plates)} plates × "
        f"{_conditions(point)}, chance {_percent(point.chance)}"
    )


def remarks(curve: SessionCurve) -> str:
    """Return what the figure says below the curve."""
    return ". ".join((*curve.remarks, INTERVAL) if curve.points else curve.remarks)


def values(curve: SessionCurve) -> tuple[Any, ...]:
    """Return the columns of ``VALUE_NAMES``."""
    rows = [
        (
            *(point.n_trials, len(point.plates), point.n_conditions, point.trained),
            *(point.tested, point.right, 100 * point.accuracy),
            *(100 * point.low, 100 * point.high, 100 * point.chance),
            yes_or_no(curve.simulated),
        )
        for point in curve.points
    ]
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _interval(point: CurvePoint) -> str:
    return f"95 % interval {100 * point.low:.1f} to {_percent(point.high)}"


def _conditions(point: CurvePoint) -> str:
    return f"{point.n_conditions} condition{'' if point.n_conditions == 1 else 's'}"
