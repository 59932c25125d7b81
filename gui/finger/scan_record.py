"""What the window knows of the newest scan, from the engine's events."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.finger_values import PredictionRow
from rigctl.values import SAMPLE_RATE_HZ, Verdict
from rigctl.wire.finger_messages import BATCH_SAMPLES

BATCH_S = BATCH_SAMPLES / SAMPLE_RATE_HZ


class AnswerState(StrEnum):
    """The verdict on the newest answer; only the answer to a whole scan is right or wrong."""

    NONE = "none"
    GROWING = "growing"
    RIGHT = "right"
    WRONG = "wrong"
    UNKNOWN = "unknown"


class ScanRecord:
    """Batches and answers of one scan after the other.

    ``texture`` and ``profile``: what the operator was asked to do in the scan. ``first_sure``: the
    first answer that kept the error rate that was asked for. ``reasons``: why the scan does not
    count. ``version`` changes with every event.
    """

    def __init__(self) -> None:
        self.version = 0
        self.scan = -1
        self.texture = self.profile = ""
        self.prediction: PredictionRow | None = None
        self.first_sure: PredictionRow | None = None
        self.reasons: tuple[str, ...] = ()
        self._announced = ("", "")
        self._edges: list[tuple[float, float]] = []
        self._velocities_mm_s: list[float] = []

    def clear(self) -> None:
        """Forget the scan, as when another engine is connected."""
        self._begin(-1)
        self._announced = ("", "")

    def announce(self, texture: str, profile: str) -> None:
        """Take what the operator is asked for; it holds from the next scan on."""
        self._announced = (texture, profile)

    def add_batch(self, data: Mapping[str, Any]) -> None:
        """Take the event ``batch``: the velocity, and the way and time scaled so far."""
        names = ("scaled_s", "distance_mm", "velocity_mm_s")
        scaled_s, distance_mm, velocity_mm_s = (float(data[name]) for name in names)
        self._follow(int(data["scan"]))
        if not self._edges:  # a window that joins in a scan knows nothing before this batch
            batch_s = min(BATCH_S, scaled_s)
            self._edges = [(scaled_s - batch_s, distance_mm - velocity_mm_s * batch_s)]
        if scaled_s > self._edges[-1][0]:
            self._edges.append((scaled_s, distance_mm))
            self._velocities_mm_s.append(velocity_mm_s)

    def add_prediction(self, data: Mapping[str, Any]) -> PredictionRow:
        """Take the event ``prediction`` and return its answer."""
        row = PredictionRow(**{name: data[name] for name in PredictionRow._fields})
        self._follow(row.scan)
        self.prediction = row
        if row.decided and self.first_sure is None:
            self.first_sure = row
        return row

    def add_trial(self, data: Mapping[str, Any]) -> None:
        """Take the event ``trial``: the scan is stored, and counts or does not."""
        self.version += 1
        is_good = data.get("verdict") == Verdict.COMMITTED
        self.reasons = () if is_good else tuple(map(str, data.get("reasons") or ("broken off",)))

    @property
    def state(self) -> AnswerState:
        """The verdict on the newest answer."""
        row = self.prediction
        if row is None:
            return AnswerState.NONE
        if not row.is_final:
            return AnswerState.GROWING
        if not row.known:
            return AnswerState.UNKNOWN
        return AnswerState.RIGHT if row.texture == self.texture else AnswerState.WRONG

    @property
    def edges_s(self) -> NDArray[np.float64]:
        """Begin of the first known batch, and the end of each, s in the scan, (batches + 1,)."""
        return np.array([at_s for at_s, _ in self._edges] or [0.0])

    @property
    def edges_mm(self) -> NDArray[np.float64]:
        """The way at the times of :attr:`edges_s`, mm, (batches + 1,)."""
        return np.array([at_mm for _, at_mm in self._edges] or [0.0])

    @property
    def velocities_mm_s(self) -> NDArray[np.float64]:
        """The velocity of each batch, (batches,)."""
        return np.array(self._velocities_mm_s)

    def _follow(self, scan: int) -> None:
        self.version += 1
        if scan != self.scan:
            self._begin(scan)
            self.texture, self.profile = self._announced

    def _begin(self, scan: int) -> None:
        self.version += 1
        self.scan = scan
        self.texture = self.profile = ""
        self.prediction = self.first_sure = None
        self.reasons = ()
        self._edges, self._velocities_mm_s = [], []
