"""Measurements of a rig from an acceptance session: force, drift, speed, steps, losses.

Force is the load cell's reading, so an error of its own calibration does not show here. Speed is
measured twice: by the length of the travel window, and by the index mark over whole turns.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.files import atomic_directory
from rigctl.analysis.report.figures import MUTED, new_figure, save_figure
from rigctl.analysis.report.html_page import render_page
from rigctl.boards.taxel_frames import Flag
from rigctl.config.rig_config import DrumGeometry
from rigctl.errors import SessionError
from rigctl.session.layout import ARRIVALS as _ARRIVALS
from rigctl.session.session import Session
from rigctl.values import SAMPLE_RATE_HZ, Event, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SETTLED_SHARE = 0.02
"""Largest deviation of every mean over :data:`MEAN_S` from the set-point, once settled."""
MEAN_S = 0.2
CONTACT_G, CONTACT_SHARE = 10.0, 0.04
"""Contact begins at this reading or this share of the set-point, whichever is larger."""
DRIFT_PRESSES = 10
TRACE_S = 2.0
Floats = NDArray[np.float64]
EARLIER = "Chaudhry et al., NER 2023, on the rig's predecessor"
COLOURS = ("#00629e", "#c24e00", "#1a8a34", "#7a3e9d", "#c8102e")
NOT_MEASURED = "not measured"
MOST_MASS_DRIFT_PERCENT = 1.0
"""Of a load cell since its calibration; a mean force may be off by as much."""


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
        missing = (*session.describe_missing(), *session.describe_repeated())
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


class AcceptanceCheck(NamedTuple):
    """One line of the report; ``passed`` is None where the session has no measurement."""

    name: str
    found: str
    limit: str
    earlier: str
    passed: bool | None


def check_limits(measured: RigMeasurements) -> tuple[AcceptanceCheck, ...]:
    """Return all checks in the order of the report."""
    return (
        _check_worst(measured, "settling time, 95 of 100 presses", "settle_p95_s", 1.0),
        _check_worst(measured, "overshoot, highest of all presses", "overshoot_percent", 5.0),
        _check_worst(measured, "mean force in the window", "mean_error_percent", 1.0),
        _check_worst(
            measured, "drift, last ten minus first ten", "drift_percent", 0.5, "3.4 % (SD 4.2 %)"
        ),
        _check_worst(
            measured, "speed by the travel window", "speed_error_percent", 0.5, "4.6 % (SD 2.6 %)"
        ),
        _check_index_speed(measured),
        _check_steps(measured),
        _check_zero("lost taxel samples", measured.lost_samples),
        _check_zero("lost load-cell samples", measured.loadcell_lost),
        _check_zero("presses that were rejected or aborted", measured.not_committed),
        _check_zero("faults", len(measured.faults)),
        *(_check_missing(line) for line in measured.missing),
    )


def _check_missing(line: str) -> AcceptanceCheck:
    """Return the failed check of a part or trials that are left out."""
    return AcceptanceCheck("record", line, "nothing is missing", "", False)


def check_known_mass(mass_g: float, read_g: float, calibrated: str) -> AcceptanceCheck:
    """Return the check of the load cell itself: how far it has drifted since its calibration.

    ``read_g``: what it reads with the mass; ``calibrated``: date and masses, empty for none.
    """
    drift_percent = 100.0 * (read_g / mass_g - 1.0)
    since = f" since {calibrated}" if calibrated else "; it was never calibrated with masses"
    found = f"{read_g:.1f} g for {mass_g:g} g: drifted by {drift_percent:+.2f} %{since}"
    passed = abs(drift_percent) <= MOST_MASS_DRIFT_PERCENT
    return AcceptanceCheck(
        "load cell with a known mass", found, f"{MOST_MASS_DRIFT_PERCENT:g} %", "", passed
    )


def is_accepted(checks: Sequence[AcceptanceCheck]) -> bool:
    """Return whether every check passed; a value that was not measured has not passed."""
    return all(check.passed for check in checks)


def _statistics(condition: PressSeries) -> dict[str, float]:
    """Return the statistics of a condition's presses; NaN for one that was not measured."""
    errors, speeds = condition.column("error"), condition.column("speed_error")
    settled = condition.column("settle_s")
    # A press that never settled is slower than all others.
    times = np.where(np.isnan(settled), np.inf, settled)
    return {
        "settle_p95_s": float(np.percentile(times, 95, method="lower")),
        "overshoot_percent": 100.0 * float(condition.column("overshoot").max()),
        "mean_error_percent": 100.0 * float(errors.mean()),
        "press_sd_percent": 100.0 * float(errors.std(ddof=1)) if len(errors) > 1 else math.nan,
        "drift_percent": 100.0 * condition.drift,
        "speed_error_percent": 100.0 * float(speeds.mean()),
        "speed_sd_percent": 100.0 * float(speeds.std(ddof=1)) if len(speeds) > 1 else math.nan,
    }


def _check_worst(
    measured: RigMeasurements, name: str, statistic: str, limit: float, earlier: str = ""
) -> AcceptanceCheck:
    """Return the check of the condition with the largest deviation."""
    values = [(_statistics(condition)[statistic], condition) for condition in measured.conditions]
    unit = "s" if statistic.endswith("_s") else "%"
    allowed = f"{limit:g} {unit}"
    if any(math.isnan(value) for value, _ in values):
        return AcceptanceCheck(name, NOT_MEASURED, allowed, earlier, None)
    worst, at = max(values, key=lambda pair: abs(pair[0]))
    text = f"{worst:.2f} {unit} at {at.speed_mm_s:g} mm/s, {at.force_g:g} g"
    return AcceptanceCheck(name, text, allowed, earlier, abs(worst) <= limit)


def _check_index_speed(measured: RigMeasurements) -> AcceptanceCheck:
    name, limit = "speed by the index mark, lifted", 0.5
    if not measured.turns:
        return AcceptanceCheck(name, NOT_MEASURED, f"{limit:g} %", "", None)
    worst = max(measured.turns, key=lambda turns: float(np.abs(turns.errors).max()))
    percent = 100.0 * float(worst.errors[np.abs(worst.errors).argmax()])
    text = f"{percent:.3f} % at {worst.speed_mm_s:g} mm/s"
    return AcceptanceCheck(name, text, f"{limit:g} %", "", abs(percent) <= limit)


def _check_steps(measured: RigMeasurements) -> AcceptanceCheck:
    name, limit = "steps counted from mark to mark", 4
    if not measured.index_errors_steps:
        return AcceptanceCheck(name, NOT_MEASURED, f"{limit} steps", "", None)
    worst = max(measured.index_errors_steps, key=abs)
    text = f"{worst} steps off in {len(measured.index_errors_steps)} checks"
    return AcceptanceCheck(name, text, f"{limit} steps", "", abs(worst) <= limit)


def _check_zero(name: str, number: int) -> AcceptanceCheck:
    return AcceptanceCheck(name, f"{number}", "0", "", number == 0)


def as_dict(measured: RigMeasurements, checks: Sequence[AcceptanceCheck]) -> dict[str, Any]:
    """Return everything as values for JSON; None for a value that was not measured."""
    return {
        "session": str(measured.path),
        "simulated": measured.simulated,
        "rig": measured.rig,
        "start_utc": measured.start_utc,
        "accepted": is_accepted(checks),
        "checks": [check._asdict() for check in checks],
        "conditions": [_condition_dict(c) for c in measured.conditions],
        "turns": [
            {"speed_mm_s": t.speed_mm_s, "errors_percent": (100.0 * t.errors).round(4).tolist()}
            for t in measured.turns
        ],
        "faults": list(measured.faults),
    }


def _condition_dict(condition: PressSeries) -> dict[str, Any]:
    return {
        "speed_mm_s": condition.speed_mm_s,
        "force_g": condition.force_g,
        "presses": len(condition.presses),
        **{
            name: round(value, 4) if math.isfinite(value) else None
            for name, value in _statistics(condition).items()
        },
    }


def write_report(measured: RigMeasurements, checks: Sequence[AcceptanceCheck], out: Path) -> Path:
    """Write report.html, acceptance.json and the figure to a new folder; return the page.

    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with atomic_directory(out) as folder:
        values = as_dict(measured, checks)
        text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / "acceptance.json").write_text(text + "\n", encoding="utf-8")
        figure = _draw_figure(measured, folder / "acceptance")
        page = render_page("acceptance.html", results=values, figure=figure, earlier_work=EARLIER)
        (folder / "report.html").write_text(page, encoding="utf-8")
    return out / "report.html"


def _draw_figure(measured: RigMeasurements, stem: Path) -> Path:
    figure, panels = new_figure((10, 8.4), 3, 1, height_ratios=[1.2, 1.2, 0.8])
    settle, drift, speed = panels
    forces = sorted({c.force_g for c in measured.conditions})
    colours = {force: COLOURS[i % len(COLOURS)] for i, force in enumerate(forces)}
    for condition in measured.conditions:
        _draw_settling(settle, condition, colours[condition.force_g])
        _draw_drift(drift, condition, colours[condition.force_g])
    settle.set(xlabel="time since contact (s)", ylabel="force over set-point (%)", ylim=(0, 120))
    drift.set(xlabel="press", ylabel="mean force error (%)")
    for force, colour in colours.items():
        drift.plot([], [], color=colour, label=f"{force:g} g")
    drift.legend(frameon=False, ncols=len(forces), loc="upper right")
    _draw_speed(speed, measured)
    bench = "Simulated bench" if measured.simulated else "Real bench"
    presses = sum(len(c.presses) for c in measured.conditions)
    origin = f"{bench} · session {measured.path.name} · {presses:,} presses"
    return save_figure(figure, stem, "Acceptance", origin)


def _draw_settling(axes: Axes, condition: PressSeries, colour: str) -> None:
    for press in condition.presses[:: max(1, len(condition.presses) // 10)]:
        percent = 100.0 * press.trace_g / condition.force_g
        axes.plot(press.trace_s, percent, color=colour, lw=0.6, alpha=0.5)
    axes.axhspan(98, 102, color=MUTED, alpha=0.12, lw=0)


def _draw_drift(axes: Axes, condition: PressSeries, colour: str) -> None:
    errors = 100.0 * condition.column("error")
    axes.plot(np.arange(1, len(errors) + 1), errors, ".", ms=3, color=colour, alpha=0.7)
    axes.axhspan(-1, 1, color=MUTED, alpha=0.06, lw=0)


def _draw_speed(axes: Axes, measured: RigMeasurements) -> None:
    for condition in measured.conditions:
        errors = 100.0 * condition.column("speed_error")
        axes.plot(np.full(len(errors), condition.speed_mm_s), errors, ".", ms=3, color=MUTED)
    for turns in measured.turns:
        errors = 100.0 * turns.errors
        axes.plot(np.full(len(errors), turns.speed_mm_s), errors, "x", ms=7, color=COLOURS[0])
    sources = "· travel window, × whole turns by the mark"
    axes.set(xlabel=f"set speed (mm/s): {sources}", ylabel="speed error (%)")
