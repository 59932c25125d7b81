"""What a rig does, measured from an acceptance session: force, drift, speed, steps, losses.

Force is what the load cell says, so an error of its own calibration does not show here. Speed is
told twice: by the travel window's length, and by the index mark over whole turns.
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
from rigctl.session.format.layout import ARRIVALS as _ARRIVALS
from rigctl.session.read.session import Session
from rigctl.values import SAMPLE_RATE_HZ, Event, Verdict
from rigctl.wire.taxels.frames import Flag

BAND = 0.02
"""A force is settled from where on every mean over :data:`MEAN_S` is so near the set-point."""
MEAN_S = 0.2
TOUCH_G, TOUCH_SHARE = 10.0, 0.04
"""Contact begins at this reading, or at this share of the set-point where that is more."""
DRIFT_PRESSES = 10
TRACE_S = 2.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Press:
    """One press. Shares are of the set-point; NaN where nothing could be measured.

    ``settle_s`` and ``overshoot`` are counted from contact until the drum turns, ``error`` is
    that of the mean force over the window, ``speed_error`` that of the window's mean speed.
    ``trace_s``, ``trace_g``: float64 (n,), the load cell from contact on.
    """

    speed_mm_s: float
    force_g: float
    settle_s: float
    overshoot: float
    error: float
    speed_error: float
    lost_samples: int
    trace_s: Floats
    trace_g: Floats


@dataclass(frozen=True, slots=True)
class TimedTurns:
    """Speed over whole turns by the index mark; ``errors`` float64 (turns,), shares."""

    speed_mm_s: float
    errors: Floats


@dataclass(frozen=True, slots=True)
class PressSeries:
    """All presses at one speed and force, in the order in which they were made.

    ``drift``: mean of the last ten less that of the first ten, NaN for fewer than twenty.
    """

    speed_mm_s: float
    force_g: float
    presses: tuple[Press, ...]

    def column(self, name: str) -> Floats:
        """One number of every press, float64 (n,)."""
        return np.array([getattr(press, name) for press in self.presses], np.float64)

    @property
    def drift(self) -> float:
        """See the class."""
        errors = self.column("error")
        if len(errors) < 2 * DRIFT_PRESSES:
            return float("nan")
        return float(errors[-DRIFT_PRESSES:].mean() - errors[:DRIFT_PRESSES].mean())


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Everything that an acceptance session says about its rig."""

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


def measure(path: Path) -> Acceptance:
    """Read a session. Raises SessionError for one without a press."""
    with Session.open(path) as session:
        trials = session.trials
        rows = [i for i in range(len(trials)) if trials["first_counter"][i] >= 0]
        presses = [_press(session, i) for i in rows if trials["force_mode"][i] == "hold"]
        if not presses:
            raise SessionError(f"{path}: no press to judge: run protocols/acceptance.toml")
        events = session.events
        committed = np.count_nonzero(trials["verdict"] == Verdict.COMMITTED.value)
        header = session.header
        return Acceptance(
            path,
            header.simulated,
            header.rig,
            header.start_utc,
            _conditions(presses),
            tuple(_turns(session, events)),
            tuple(e.data["index_error_steps"] for e in events if "index_error_steps" in e.data),
            int(session.gaps["count"].sum()),
            session.loadcell_lost(),
            len(trials) - int(committed),
            tuple(e.text for e in events if e.kind == "fault"),
        )


def _conditions(presses: Iterable[Press]) -> tuple[PressSeries, ...]:
    groups: dict[tuple[float, float], list[Press]] = defaultdict(list)
    for press in presses:
        groups[press.force_g, press.speed_mm_s].append(press)
    return tuple(
        PressSeries(speed, force, tuple(groups[force, speed])) for force, speed in sorted(groups)
    )


def _press(session: Session, index: int) -> Press:
    row, drum = session.trials[index], session.config.drum
    force_g, speed = float(row["force_g"]), float(row["speed_mm_s"])
    told = session.drum(index)
    times, forces = told.loadcell_s, told.loadcell["force_g"].astype(np.float64)
    touched = np.flatnonzero(forces > max(TOUCH_G, TOUCH_SHARE * force_g))
    contact_s = float(times[touched[0]]) if touched.size else float("nan")
    still = (times >= contact_s) & (times < -_run_in_s(speed, drum))
    shown = (times >= contact_s - 0.1) & (times < contact_s + TRACE_S)
    return Press(
        speed,
        force_g,
        settle_s(times[still] - contact_s, forces[still], force_g),
        float(forces[still].max() / force_g - 1.0) if still.any() else float("nan"),
        float(row["mean_force_g"]) / force_g - 1.0,
        float(row["mean_speed_mm_s"]) / speed - 1.0,
        int(row["count"]) - len(session.window(index).counters),
        times[shown] - contact_s,
        forces[shown],
    )


def _run_in_s(speed_mm_s: float, drum: DrumGeometry) -> float:
    """From the first step to the window: a ramp takes twice the time of its travel."""
    return drum.run_in_mm / speed_mm_s + speed_mm_s / (2.0 * drum.acceleration_mm_s2)


def settle_s(times_s: Floats, force_g: Floats, set_g: float) -> float:
    """When the force had settled, on the clock of ``times_s``; NaN where it never did.

    The first time from which on every mean over 200 ms is within 2 % of ``set_g``. Arrays
    float64 (n,) with even times.
    """
    if len(times_s) < 2:
        return float("nan")
    width = max(1, round(MEAN_S / float(np.diff(times_s).mean())))
    if len(force_g) < width:
        return float("nan")
    means = np.convolve(force_g, np.ones(width) / width, "valid")
    outside = np.flatnonzero(np.abs(means / set_g - 1.0) > BAND)
    first = int(outside[-1]) + 1 if outside.size else 0
    return float(times_s[first]) if first < len(means) else float("nan")


def _turns(session: Session, events: Sequence[Event]) -> Iterable[TimedTurns]:
    """Turns between two events, each timed from mark to mark by the taxel board's clock."""
    begun: Event | None = None
    circumference = session.config.drum.circumference_mm
    for event in (e for e in events if e.kind == "turn" and "begins" in e.data):
        if event.data["begins"]:
            begun = event
        elif begun is not None:
            speed = float(event.data["speed_mm_s"])
            marks_s = _marks_s(session, begun.at_s, event.at_s, _taxels_ppm(events, event.at_s))
            if len(marks_s) > 1:
                yield TimedTurns(speed, circumference / np.diff(marks_s) / speed - 1.0)


def _taxels_ppm(events: Sequence[Event], at_s: float) -> float:
    told = [e for e in events if e.kind == "clock" and "taxels_ppm" in e.data]
    known = [e for e in told if e.at_s <= at_s] or told
    return float(known[-1].data["taxels_ppm"]) if known else 0.0


def _marks_s(session: Session, from_s: float, to_s: float, ppm: float) -> Floats:
    """True seconds of the index marks between two loop times; their zero means nothing."""
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
