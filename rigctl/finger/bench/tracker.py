"""The tracker on the operator's wrist: what it measures, and when its measurements arrive."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rigctl.errors import LinkLost
from rigctl.finger.bench.operator import ACROSS, ALONG, HEIGHT, WRIST_ALONG
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.values import PLATE_CORNERS_MM
from rigctl.values import Position

_Floats = NDArray[np.float64]
OnPosition = Callable[[Position], None]
OnLost = Callable[[str], None]


class SimulatedTracker:
    """A tracker that reports the wrist in a frame of its own. All calls come from one thread.

    ``row_at(time_ms)`` returns the hand's true row at a time, see
    :data:`rigctl.finger.bench.operator.ALONG`; ``session`` draws what stays the same within a
    session. Callers open it, pass time with :meth:`advance`, and begin slides.
    """

    def __init__(
        self,
        parameters: TrackerParameters,
        operator: OperatorParameters,
        row_at: Callable[[float], _Floats],
        session: np.random.Generator,
    ) -> None:
        self.name = "simulated tracker"
        self.plugged = True
        self._p = parameters
        self._row_at = row_at
        self._wrist_mm = np.array([-operator.wrist_behind_mm, 0.0, operator.wrist_above_mm])
        self._touch_mm = operator.corner_touch_mm
        tilt = parameters.frame_tilt_deg * session.standard_normal(2)
        turn = [*tilt, session.uniform(-180.0, 180.0)]
        self._turn: _Floats = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
        self._origin_mm = session.uniform(-1000.0, 1000.0, 3)
        late_ms = max(1.0, session.normal(parameters.latency_ms, parameters.latency_error_ms))
        self._latency_us = 1000.0 * late_ms
        self._session = self._random = session
        self._measure_us = session.uniform(0.0, self.period_us)
        self._gap_until_us = self._lost_until_us = -math.inf
        self._shifts = False
        self.next_us = self._measure_us + self._latency_us
        self._touched_mm: _Floats | None = None
        self._on_position: OnPosition | None = None
        self._on_lost: OnLost | None = None

    @property
    def measured_us(self) -> float:
        """Time of the measurement that is being delivered, by the tracker's own clock."""
        return self._measure_us

    @property
    def period_us(self) -> float:
        """Time from one measurement to the next."""
        return 1e6 / self._p.rate_hz

    def open(self, on_position: OnPosition, on_lost: OnLost) -> None:
        """Start receiving: ``on_position`` for each measurement, ``on_lost(reason)`` once.

        Raises LinkLost if the tracker is unplugged or already open.
        """
        if not self.plugged:
            raise LinkLost(f"{self.name}: not found: switch the tracker on")
        if self._on_position is not None:
            raise LinkLost(f"{self.name}: already in use: close the other program")
        self._on_position, self._on_lost = on_position, on_lost

    def close(self) -> None:
        """Stop receiving; a second call does nothing."""
        self._on_position = self._on_lost = None

    def unplug(self) -> None:
        """Switch the tracker off and report the loss to the host."""
        on_lost = self._on_lost
        self.plugged = False
        self.close()
        if on_lost is not None:
            on_lost(f"{self.name}: it sends nothing more: switch the tracker on")

    def replug(self) -> None:
        """Switch it on; the host must open it again."""
        self.plugged = True

    def lose(self, now_us: float, seconds: float) -> None:
        """Hide the tracker from its base stations for a time; its frame shifts afterwards."""
        self._lost_until_us = now_us + 1e6 * seconds
        self._shifts = True

    def begin_slide(self, random: np.random.Generator) -> None:
        """Draw noise, jitter and gaps from a slide's own generator from now on."""
        self._random = random
        self._touched_mm = None

    def touch_corner(self, name: str, random: np.random.Generator) -> None:
        """Report the wrist of a finger that rests on a corner, until the next slide begins."""
        self._touched_mm = self._touch(name, random)

    def advance(self) -> None:
        """Deliver the measurement that arrives at ``next_us``, and time the next one."""
        random, p = self._random, self._p
        if self._measure_us >= self._gap_until_us:
            gap = random.random() < p.dropouts_per_min * self.period_us / 60e6
            if gap:
                gap_us = 1000.0 * p.dropout_ms * random.exponential()
                self._gap_until_us = self._measure_us + max(gap_us, self.period_us)
        if self._measure_us >= self._gap_until_us:
            self._deliver(random.normal(0.0, p.noise_mm, 3))
        self._measure_us += self.period_us
        jitter_us = 1000.0 * p.arrival_jitter_ms * random.exponential()
        self.next_us = max(self._measure_us + self._latency_us + jitter_us, self.next_us + 1.0)

    def touch_corners(
        self, random: np.random.Generator
    ) -> list[tuple[str, tuple[float, float, float]]]:
        """Return what the tracker reads while the finger touches each corner of the plate, mm."""
        touched = []
        for name in PLATE_CORNERS_MM:
            place = self._to_frame(self._touch(name, random))
            measured = place + random.normal(0.0, self._p.noise_mm, 3)
            x, y, z = measured.tolist()
            touched.append((name, (x, y, z)))
        return touched

    def _touch(self, name: str, random: np.random.Generator) -> _Floats:
        """Return the wrist's place on the plate while the finger touches a corner, mm."""
        error_mm = random.normal(0.0, self._touch_mm, 3)
        wrist: _Floats = np.array([*PLATE_CORNERS_MM[name], 0.0]) + self._wrist_mm + error_mm
        return wrist

    def _deliver(self, noise_mm: _Floats) -> None:
        valid = self._measure_us >= self._lost_until_us
        if valid and self._shifts:
            self._shifts = False
            self._origin_mm = self._origin_mm + self._session.normal(
                0.0, self._p.shift_after_loss_mm, 3
            )
        if self._on_position is None:
            return
        x, y, z = (self._to_frame(self._wrist()) + noise_mm).tolist()
        at_s = (self.next_us - 1000.0 * self._p.latency_ms) * 1e-6
        self._on_position(Position(at_s, x, y, z, valid))

    def _wrist(self) -> _Floats:
        """Return the wrist's place on the plate at the time of the measurement, mm."""
        if self._touched_mm is not None:
            return self._touched_mm
        row = self._row_at(self._measure_us * 1e-3)
        wrist: _Floats = row[[ALONG, ACROSS, HEIGHT]] + self._wrist_mm + row[WRIST_ALONG:]
        return wrist

    def _to_frame(self, plate_mm: _Floats) -> _Floats:
        frame: _Floats = self._turn @ plate_mm + self._origin_mm
        return frame
