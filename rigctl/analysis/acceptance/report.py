"""The acceptance report: measurements against their limits, as JSON, figure and page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.analysis.acceptance.measurements import PressSeries, RigMeasurements
from rigctl.analysis.data.atomic_directory import atomic_directory
from rigctl.analysis.report.figures import MUTED, add_titles, save_figure, style_axes
from rigctl.analysis.report.html_page import render_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EARLIER = "Chaudhry et al., NER 2023, on the rig's predecessor"
COLOURS = ("#00629e", "#c24e00", "#1a8a34", "#7a3e9d", "#c8102e")
NOT_MEASURED = "not measured"


@dataclass(frozen=True, slots=True)
class AcceptanceCheck:
    """One line of the report; ``passed`` is None where the session has no measurement."""

    name: str
    found: str
    limit: str
    earlier: str
    passed: bool | None


def check_limits(found: RigMeasurements) -> tuple[AcceptanceCheck, ...]:
    """Return all checks in the order of the report."""
    return (
        _worst(found, "settling time, 95 of 100 presses", _p95_settle, 1.0, "s"),
        _worst(found, "overshoot, highest of all presses", _overshoot, 5.0),
        _worst(found, "mean force in the window", _mean_error, 1.0),
        _worst(found, "drift, last ten less first ten", _drift, 0.5, earlier="3.4 % (SD 4.2 %)"),
        _worst(found, "speed by the travel window", _window_speed, 0.5, earlier="4.6 % (SD 2.6 %)"),
        _check_index_speed(found),
        _check_steps(found),
        _check_zero("lost taxel samples", found.lost_samples),
        _check_zero("lost load-cell samples", found.loadcell_lost),
        _check_zero("presses that were rejected or broken off", found.not_committed),
        _check_zero("faults", len(found.faults)),
    )


def is_accepted(checks: Sequence[AcceptanceCheck]) -> bool:
    """Return whether every check passed; a value that was not measured has not passed."""
    return all(check.passed for check in checks)


def _p95_settle(condition: PressSeries) -> float:
    settled = condition.column("settle_s")
    # A press that never settled is slower than all others.
    return float(np.percentile(np.where(np.isnan(settled), np.inf, settled), 95, method="lower"))


def _overshoot(condition: PressSeries) -> float:
    return 100.0 * float(condition.column("overshoot").max())


def _mean_error(condition: PressSeries) -> float:
    return 100.0 * float(condition.column("error").mean())


def _drift(condition: PressSeries) -> float:
    return 100.0 * condition.drift


def _window_speed(condition: PressSeries) -> float:
    return 100.0 * float(condition.column("speed_error").mean())


def _worst(
    found: RigMeasurements,
    name: str,
    value_of: Callable[[PressSeries], float],
    limit: float,
    unit: str = "%",
    earlier: str = "",
) -> AcceptanceCheck:
    """Return the check of the condition with the largest deviation."""
    values = [(value_of(c), c) for c in found.conditions]
    allowed = f"{limit:g} {unit}"
    if any(math.isnan(value) for value, _ in values):
        return AcceptanceCheck(name, NOT_MEASURED, allowed, earlier, None)
    worst, at = max(values, key=lambda pair: abs(pair[0]))
    text = f"{worst:.2f} {unit} at {at.speed_mm_s:g} mm/s, {at.force_g:g} g"
    return AcceptanceCheck(name, text, allowed, earlier, abs(worst) <= limit)


def _check_index_speed(found: RigMeasurements) -> AcceptanceCheck:
    name, limit = "speed by the index mark, lifted", 0.5
    if not found.turns:
        return AcceptanceCheck(name, NOT_MEASURED, f"{limit:g} %", "", None)
    worst = max(found.turns, key=lambda turns: float(np.abs(turns.errors).max()))
    percent = 100.0 * float(worst.errors[np.abs(worst.errors).argmax()])
    text = f"{percent:.3f} % at {worst.speed_mm_s:g} mm/s"
    return AcceptanceCheck(name, text, f"{limit:g} %", "", abs(percent) <= limit)


def _check_steps(found: RigMeasurements) -> AcceptanceCheck:
    name, limit = "steps counted from mark to mark", 4
    if not found.index_errors_steps:
        return AcceptanceCheck(name, NOT_MEASURED, f"{limit} steps", "", None)
    worst = max(found.index_errors_steps, key=abs)
    text = f"{worst} steps off in {len(found.index_errors_steps)} checks"
    return AcceptanceCheck(name, text, f"{limit} steps", "", abs(worst) <= limit)


def _check_zero(name: str, number: int) -> AcceptanceCheck:
    return AcceptanceCheck(name, f"{number}", "0", "", number == 0)


def as_dict(found: RigMeasurements, checks: Sequence[AcceptanceCheck]) -> dict[str, Any]:
    """Return everything as values for JSON; None for a value that was not measured."""
    return {
        "session": str(found.path),
        "simulated": found.simulated,
        "rig": found.rig,
        "start_utc": found.start_utc,
        "accepted": is_accepted(checks),
        "checks": [
            {name: getattr(c, name) for name in ("name", "found", "limit", "earlier", "passed")}
            for c in checks
        ],
        "conditions": [_condition_dict(c) for c in found.conditions],
        "turns": [
            {"speed_mm_s": t.speed_mm_s, "errors_percent": (100.0 * t.errors).round(4).tolist()}
            for t in found.turns
        ],
        "faults": list(found.faults),
    }


def _condition_dict(condition: PressSeries) -> dict[str, Any]:
    errors, speeds = condition.column("error"), condition.column("speed_error")
    values = {
        "settle_p95_s": _p95_settle(condition),
        "overshoot_percent": _overshoot(condition),
        "mean_error_percent": _mean_error(condition),
        "press_sd_percent": 100.0 * float(errors.std(ddof=1)) if len(errors) > 1 else math.nan,
        "drift_percent": _drift(condition),
        "speed_error_percent": _window_speed(condition),
        "speed_sd_percent": 100.0 * float(speeds.std(ddof=1)) if len(speeds) > 1 else math.nan,
    }
    rounded = {name: round(v, 4) if math.isfinite(v) else None for name, v in values.items()}
    return {
        "speed_mm_s": condition.speed_mm_s,
        "force_g": condition.force_g,
        "presses": len(condition.presses),
        **rounded,
    }


def write_report(found: RigMeasurements, checks: Sequence[AcceptanceCheck], out: Path) -> Path:
    """Write report.html, acceptance.json and the figure to a new folder; return the page.

    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with atomic_directory(out) as folder:
        values = as_dict(found, checks)
        text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / "acceptance.json").write_text(text + "\n", encoding="utf-8")
        figure = _draw_figure(found, folder / "acceptance")
        page = render_page("acceptance.html", plain=values, figure=figure, earlier_work=EARLIER)
        (folder / "report.html").write_text(page, encoding="utf-8")
    return out / "report.html"


def _draw_figure(found: RigMeasurements, stem: Path) -> Path:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8.4), layout="constrained")
    settle, drift, speed = figure.subplots(3, 1, gridspec_kw={"height_ratios": [1.2, 1.2, 0.8]})
    forces = sorted({c.force_g for c in found.conditions})
    colours = {force: COLOURS[i % len(COLOURS)] for i, force in enumerate(forces)}
    for condition in found.conditions:
        _draw_settling(settle, condition, colours[condition.force_g])
        _draw_drift(drift, condition, colours[condition.force_g])
    _label(settle, "time since contact (s)", "force over set-point (%)")
    settle.set_ylim(0, 120)
    _label(drift, "press", "mean force error (%)")
    for force, colour in colours.items():
        drift.plot([], [], color=colour, label=f"{force:g} g")
    drift.legend(frameon=False, ncols=len(forces), loc="upper right")
    _draw_speed(speed, found)
    bench = "Simulated bench" if found.simulated else "Real bench"
    presses = sum(len(c.presses) for c in found.conditions)
    add_titles(figure, "Acceptance", f"{bench} · session {found.path.name} · {presses:,} presses")
    return save_figure(figure, stem)


def _label(axes: Axes, x: str, y: str) -> None:
    style_axes(axes)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def _draw_settling(axes: Axes, condition: PressSeries, colour: str) -> None:
    for press in condition.presses[:: max(1, len(condition.presses) // 10)]:
        percent = 100.0 * press.trace_g / condition.force_g
        axes.plot(press.trace_s, percent, color=colour, lw=0.6, alpha=0.5)
    axes.axhspan(98, 102, color=MUTED, alpha=0.12, lw=0)


def _draw_drift(axes: Axes, condition: PressSeries, colour: str) -> None:
    errors = 100.0 * condition.column("error")
    axes.plot(np.arange(1, len(errors) + 1), errors, ".", ms=3, color=colour, alpha=0.7)
    axes.axhspan(-1, 1, color=MUTED, alpha=0.06, lw=0)


def _draw_speed(axes: Axes, found: RigMeasurements) -> None:
    for condition in found.conditions:
        errors = 100.0 * condition.column("speed_error")
        axes.plot(np.full(len(errors), condition.speed_mm_s), errors, ".", ms=3, color=MUTED)
    for turns in found.turns:
        errors = 100.0 * turns.errors
        axes.plot(np.full(len(errors), turns.speed_mm_s), errors, "x", ms=7, color=COLOURS[0])
    _label(axes, "set speed (mm/s): · travel window, × whole turns by the mark", "speed error (%)")
