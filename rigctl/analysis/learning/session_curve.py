"""The learning curve of one session, which may still be recorded, and what it says in words."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from rigctl.analysis.execution.executor import Progress
from rigctl.analysis.learning.complete_block import RecordedTrials
from rigctl.analysis.learning.growing_features import GrowingFeatures
from rigctl.analysis.learning.learning_curve import CurvePoint, LearningCurve


class SessionCurve(NamedTuple):
    """The points of a session's learning curve.

    ``trials``: those that it may use; ``committed``: all that count. ``shortfall``: why there is no
    point yet, empty where there is one. ``remarks``: sentences on what the curve holds.
    """

    folder: str
    points: tuple[CurvePoint, ...] = ()
    trials: int = 0
    committed: int = 0
    simulated: bool = False
    shortfall: str = ""
    remarks: tuple[str, ...] = ()


class SessionCurves:
    """Computes the curve of one session after the other, and remembers the features of one."""

    def __init__(self) -> None:
        self._features: GrowingFeatures | None = None
        self._curve = LearningCurve()
        self._changes = 0

    def curve(
        self, folder: str, progress: Progress = lambda stage, done, total: None
    ) -> SessionCurve:
        """Return the curve of the trials so far. Raises SessionError."""
        growing = self._open(Path(folder))
        growing.update(progress)
        if growing.changes != self._changes:
            self._changes = growing.changes
            self._curve.forget()
        trials = growing.by_condition()
        progress("classifying", 0, 1)
        points = self._curve.points(trials, growing.features)
        used = len(growing.usable_rows())
        committed = len(growing.session.committed())
        shortfall = "" if points else describe_shortfall(trials)
        simulated = growing.session.header.simulated
        remarks = tuple(_remarks(growing, trials, points, committed - used))
        return SessionCurve(folder, points, used, committed, simulated, shortfall, remarks)

    def close(self) -> None:
        """Close the session that is open."""
        if self._features is not None:
            self._features.close()
        self._features = None

    def _open(self, folder: Path) -> GrowingFeatures:
        if self._features is None or self._features.session.path != folder:
            self.close()
            self._features = GrowingFeatures(folder)
            self._curve, self._changes = LearningCurve(), 0
        return self._features


def describe_shortfall(trials: RecordedTrials) -> str:
    """Return which trials the first point still needs."""
    counts = {plate: sum(map(len, cells.values())) for plate, cells in trials.items()}
    if not counts:
        return "Not enough trials yet: no complete trial with motion is recorded."
    so_far = ", ".join(f"{plate} has {n}" for plate, n in sorted(counts.items()))
    if len(counts) == 1:
        return f"Not enough trials yet: two plates are needed to tell them apart; {so_far}."
    return (
        "Not enough trials yet: two plates need three trials each, at the same speeds and forces; "
        f"{so_far}."
    )


def _remarks(
    growing: GrowingFeatures, trials: RecordedTrials, points: tuple[CurvePoint, ...], without: int
) -> list[str]:
    lines = []
    if not growing.has_calibrated_range:
        lines.append(
            "No calibrated range of the taxels: that of the first trials holds, and the curve "
            "changes when there are twice as many"
        )
    waiting = sorted(set(trials) - set(points[-1].plates)) if points else []
    if waiting:
        lines.append(f"Without {', '.join(waiting)}: too few trials for the last point")
    if without:
        trials_are = "trial is" if without == 1 else "trials are"
        lines.append(f"{without} {trials_are} left out: no motion, or samples are missing")
    return lines
