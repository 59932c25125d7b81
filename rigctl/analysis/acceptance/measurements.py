"""Measurements of a rig from an acceptance session: force, drift, speed, steps, losses.

Force is the load cell's reading, so an error of its own calibration does not show here. Speed is
measured twice: by the length of the travel window, and by the index mark over whole turns.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import DrumGeometry
from rigctl.errors import SessionError
from rigctl.session.layout import ARRIVALS as _ARRIVALS
from rigctl.session.session import Session
from rigctl.values import SAMPLE_RATE_HZ, Event, Verdict
from rigctl.wire.taxels.frames import Flag

SETTLED_SHARE = 0.02
"""Largest deviation of every mean over :data:`MEAN_S` from the set-point, once settled."""
MEAN_S = 0.2
CONTACT_G, CONTACT_SHARE = 10.0, 0.04
"""Contact begins at this reading or this share of the set-point, whichever is larger."""
DRIFT_PRESSES = 10
TRACE_S = 2.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Press:
    """One press. Errors are shares of the set-point; NaN for a value that was not measured.

    ``settle_s`` and ``overshoot``: from contact until the drum turns. ``error``: of the mean force
    over the window. ``speed_error``: of the mean speed over the window.
    ``trace_s``, ``trace_g``: float64 (n,), the load cell from contact on.
    """

    speed_mm_s: float
    force_g: float
    settle_s: float
    overshoot: float
    error: float
    speed_error: float
    trace_s: Floats
    trace_g: Floats


@dataclass(frozen=True, slots=True)
class TimedTurns:
    """Speed errors of whole turns by the index mark; ``errors`` float64 (turns,), shares."""

    speed_mm_s: float
    errors: Floats


@dataclass(frozen=True, slots=True)
class PressSeries:
    """All presses at one speed and force, in the order of recording."""

    speed_mm_s: float
    force_g: float
    presses: tuple[Press, ...]

    def column(self, name: str) -> Floats:
        """Return one attribute of every press, float64 (n,)."""
        return np.array([getattr(press, name) for press in self.presses], np.float64)

    @property
    def drift(self) -> float:
        """Mean error of the last ten presses less that of the first ten, NaN below twenty."""
        errors = self.column("error")
        if len(errors) < 2 * DRIFT_PRESSES:
            return float("nan")
        return float(errors[-DRIFT_PRESSES:].mean() - errors[:DRIFT_PRESSES].mean())


@dataclass(frozen=True, slots=True)
class RigMeasurements:
    """All measurements of an acceptance session."""

    path: Path
    simulated: bool
    rig: str
    start_utc: str
    conditions: tuple[PressSeries, ...]
    turns: tuple[TimedTurns, ...]
    index_errors_steps: tuple[int, ...]
    lost_samples: int
    loadcell_lost: int
    not_committed: int
    faults: tuple[str, ...]
    missing: tuple[str, ...] = ()


def measure(path: Path) -> RigMeasurements:
    """Measure a session. Raises SessionError for a session without a press."""
    with Session.open(path) as session:
        trials = session.trials
        seen = (i for i in range(len(trials)) if i not in session.left_out)
        rows = [i for i in seen if trials["first_counter"][i] >= 0]
        presses = [_measure_press(session, i) for i in rows if trials["force_mode"][i] == "hold"]
        if not presses:
            raise SessionError(f"{path}: no press to evaluate: run protocols/acceptance.toml")
        events = session.events
        committed = np.count_nonzero(trials["verdict"] == Verdict.COMMITTED.value)
        missing = tuple(session.describe_missing())
        header = session.header
        return RigMeasurements(
            path,
            header.simulated,
            header.rig,
            header.start_utc,
            _group_by_condition(presses),
            tuple(_time_turns(session, events)),
            tuple(e.data["index_error_steps"] for e in events if "index_error_steps" in e.data),
            int(session.gaps["count"].sum()),
            session.loadcell_lost(),
            len(trials) - int(committed),
            tuple(e.text for e in events if e.kind == "fault"),
            missing,
        )


def _group_by_condition(presses: Iterable[Press]) -> tuple[PressSeries, ...]:
    groups: dict[tuple[float, float], list[Press]] = defaultdict(list)
    for press in presses:
        groups[press.force_g, press.speed_mm_s].append(press)
    return tuple(
        PressSeries(speed, force, tuple(groups[force, speed])) for force, speed in sorted(groups)
    )


def _measure_press(session: Session, index: int) -> Press:
    row, drum = session.trials[index], session.config.drum
    force_g, speed = float(row["force_g"]), float(row["speed_mm_s"])
    drum_rows = session.drum(index)
    times, forces = drum_rows.loadcell_s, drum_rows.loadcell["force_g"].astype(np.float64)
    contact = np.flatnonzero(forces > max(CONTACT_G, CONTACT_SHARE * force_g))
    contact_s = float(times[contact[0]]) if contact.size else float("nan")
    still = (times >= contact_s) & (times < -_run_in_s(speed, drum))
    shown = (times >= contact_s - 0.1) & (times < contact_s + TRACE_S)
    return Press(
        speed,
        force_g,
        settling_time_s(times[still] - contact_s, forces[still], force_g),
        float(forces[still].max() / force_g - 1.0) if still.any() else float("nan"),
        float(row["mean_force_g"]) / force_g - 1.0,
        float(row["mean_speed_mm_s"]) / speed - 1.0,
        times[shown] - contact_s,
        forces[shown],
    )


def _run_in_s(speed_mm_s: float, drum: DrumGeometry) -> float:
    """Return the time from the first step to the window; a ramp takes twice its travel's time."""
    return drum.run_in_mm / speed_mm_s + speed_mm_s / (2.0 * drum.acceleration_mm_s2)


def settling_time_s(times_s: Floats, force_g: Floats, set_g: float) -> float:
    """Return the time from which every mean over 200 ms is within 2 % of ``set_g``, else NaN.

    Arrays: float64 (n,), with even times.
    """
    if len(times_s) < 2:
        return float("nan")
    width = max(1, round(MEAN_S / float(np.diff(times_s).mean())))
    if len(force_g) < width:
        return float("nan")
    means = np.convolve(force_g, np.ones(width) / width, "valid")
    outside = np.flatnonzero(np.abs(means / set_g - 1.0) > SETTLED_SHARE)
    first = int(outside[-1]) + 1 if outside.size else 0
    return float(times_s[first]) if first < len(means) else float("nan")


def _time_turns(session: Session, events: Sequence[Event]) -> Iterable[TimedTurns]:
    """Time each turn from mark to mark by the clock of the taxel board."""
    start: Event | None = None
    circumference = session.config.drum.circumference_mm
    for event in (e for e in events if e.kind == "turn" and "begins" in e.data):
        if event.data["begins"]:
            start = event
        elif start is not None:
            speed = float(event.data["speed_mm_s"])
            marks_s = _mark_times_s(
                session, start.at_s, event.at_s, _taxel_clock_ppm(events, event.at_s)
            )
            if len(marks_s) > 1:
                yield TimedTurns(speed, circumference / np.diff(marks_s) / speed - 1.0)


def _taxel_clock_ppm(events: Sequence[Event], at_s: float) -> float:
    fits = [e for e in events if e.kind == "clock" and "taxels_ppm" in e.data]
    earlier = [e for e in fits if e.at_s <= at_s] or fits
    return float(earlier[-1].data["taxels_ppm"]) if earlier else 0.0


def _mark_times_s(session: Session, from_s: float, to_s: float, ppm: float) -> Floats:
    """Return the times of the index marks between two loop times, from an arbitrary zero."""
    for part in session.parts:
        blocks = part.rows(_ARRIVALS)
        inside = np.flatnonzero((blocks["arrived_s"] >= from_s) & (blocks["arrived_s"] <= to_s))
        if inside.size:
            first, last = int(blocks["first_row"][inside[0]]), int(blocks["first_row"][inside[-1]])
            flags = part.read("/taxels/flags", first, last)
            counters = part.read("/taxels/counter", first, last)
            marks = counters[np.flatnonzero(flags & np.uint8(Flag.INDEX))]
            return marks.astype(np.float64) / (SAMPLE_RATE_HZ * (1.0 + ppm * 1e-6))
    return np.empty(0)
