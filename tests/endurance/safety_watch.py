"""Watches the bench's own log for unsafe states, whatever boards and computer believe.

A state is unsafe

* where the force exceeds the board's limit by more than the travel until it lifts explains; while a
  part is broken that limit is the compiled one, with the travel that a broken load cell costs;
* where the actuator goes down 0.5 s after the computer fell silent, or anything moves after the
  longest lift;
* where the drum turns or the actuator moves while the emergency stop is pressed.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from rigctl.bench.circuit import AS_DRAWN
from rigctl.bench.contact import contact_tables, draw_mounting, force_table
from rigctl.bench.mechanics import DRUM_MM, FORCE_G, RING_MS
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import LoadcellFault
from rigctl.engine.rig import Rig
from tests.attack.judge import (
    COAST_MS,
    LIFT_LIMIT_MS,
    MOST_FORCE_G,
    SILENCE_MS,
    STEP_END_MS,
    STILL_MM,
    UNFELT_UM,
)
from tests.firmware.drum.support.overshoot import overshoot_g

STEP_US = 20_000
SPAN_MS = 40
"""What is judged at once."""
OVERRUN_UM = 6.0 * 50.0
"""At the actuator's full speed: sample, delay, tick and lag (the register ``overrun_um``)."""
OVER_FORCE_G = 1400.0
WHOLE_AFTER_MS = 20_000
"""A part that was broken is judged as whole after this time."""


class SafetyWatch:
    """Sees every millisecond of a simulated rig. ``unsafe``: a sentence for each unsafe state."""

    def __init__(self, rig: Rig) -> None:
        self.unsafe: list[str] = []
        self.most_g = 0.0
        self._simulation = simulation = rig.simulation
        self._bench = simulation._bench
        self._advance = simulation.advance
        simulation.advance = self._advance_watched
        self._cable = simulation.drum
        self._write = self._cable.write
        self._cable.write = self._write_heard
        self._now_ms = self._heard_ms = self._bench.plant.time_ms
        self._broken_ms = -WHOLE_AFTER_MS
        self._stop_since_ms: int | None = None
        self._rod_mm = self._bench.plant.rod_mm

    def _advance_watched(self, until_us: int) -> None:
        while self._simulation.time_us + STEP_US < until_us:
            self._advance(self._simulation.time_us + STEP_US)
            self._check()
        self._advance(until_us)
        self._check()

    def _write_heard(self, data: bytes) -> None:
        self._write(data)
        if not self._cable.stalled:
            self._heard_ms = self._simulation.time_us // 1000

    def _check(self) -> None:
        plant, start_ms = self._bench.plant, self._now_ms
        if plant.time_ms < start_ms + SPAN_MS:
            return
        self._now_ms = plant.time_ms
        rows = np.arange(start_ms, self._now_ms + 1) % RING_MS
        log = plant.log[rows]
        rod_mm, self._rod_mm = self._rod_mm, plant.rod_mm
        self._note_disturbances(start_ms)
        self._check_force(float(log[1:, FORCE_G].max()))
        moved_mm = self._rod_mm - rod_mm
        turned_mm = float(np.ptp(log[:, DRUM_MM]))
        self._check_silence(start_ms, moved_mm, turned_mm)
        self._check_stop(start_ms, moved_mm, turned_mm)

    def _note_disturbances(self, start_ms: int) -> None:
        now = self._bench.disturbances
        if now.circuit != AS_DRAWN or now.loadcell != LoadcellFault.NONE or now.push_g:
            self._broken_ms = start_ms
        if not now.estop_pressed:
            self._stop_since_ms = None
        elif self._stop_since_ms is None:
            self._stop_since_ms = self._now_ms

    def _check_force(self, force_g: float) -> None:
        self.most_g = max(self.most_g, force_g)
        is_whole = self._now_ms - self._broken_ms > WHOLE_AFTER_MS
        most_g = OVER_FORCE_G if is_whole else MOST_FORCE_G
        if force_g <= most_g:
            return
        travel_um = OVERRUN_UM if is_whole else OVERRUN_UM + UNFELT_UM
        bench = self._bench
        limit_g = most_g + _overshoot_g(
            bench.plate, bench.parameters, bench.seed, bench._mountings - 1, travel_um, most_g
        )
        if force_g > limit_g:
            self._tell(f"{force_g:.0f} g of at most {limit_g:.0f} g")

    def _check_silence(self, start_ms: int, moved_mm: float, turned_mm: float) -> None:
        silent_ms = start_ms - self._heard_ms
        if silent_ms < SILENCE_MS + COAST_MS:
            return
        if moved_mm > STILL_MM:
            self._tell(f"presses {moved_mm:.2f} mm after {silent_ms} ms of silence")
        if silent_ms > SILENCE_MS + LIFT_LIMIT_MS and (abs(moved_mm) > STILL_MM or turned_mm > 0):
            self._tell(f"moves after {silent_ms} ms of silence")

    def _check_stop(self, start_ms: int, moved_mm: float, turned_mm: float) -> None:
        if self._stop_since_ms is None:
            return
        held_ms = start_ms - self._stop_since_ms
        if held_ms > STEP_END_MS and turned_mm > 0:
            self._tell(f"turns {held_ms} ms after the emergency stop")
        if held_ms > COAST_MS and abs(moved_mm) > STILL_MM:
            self._tell(f"the actuator moves {held_ms} ms after the emergency stop")

    def _tell(self, what: str) -> None:
        self.unsafe.append(f"{self._now_ms / 1000:.2f} s: {what}")


@lru_cache(maxsize=32)
def _overshoot_g(
    plate: str,
    parameters: WorldParameters,
    seed: int,
    mounting: int,
    travel_um: float,
    most_g: float,
) -> float:
    """Return how far the force of a mounted plate may exceed a limit within a travel."""
    pressed: Any = force_table(
        contact_tables(plate, parameters), parameters, draw_mounting(parameters, seed, mounting)
    )
    return overshoot_g(travel_um, most_g, pressed)
