"""Measure how each taxel answers to the force on a smooth plate, and the force that all show.

A session of ``protocols/sensor.toml`` presses the smooth plate at rising and falling forces. Each
taxel gets its curve of mean reading over force, and how far it departs from it: with the direction
of the force, the speed, the repeat and the time. The sum of all taxels' readings, read backwards
through its curve, estimates the force; its error is that of trials which the curve does not know.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.files import atomic_directory
from rigctl.analysis.report.figures import MUTED, RA_COLOUR, SA_COLOUR, new_figure, save_figure
from rigctl.analysis.report.html_page import render_page
from rigctl.analysis.trial_set import TrialSet, join_sessions, open_trials
from rigctl.encoder.reading import Reading
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.session import Session

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FEWEST_FORCES = 4
LEAST_SPAN_NOISE = 8.0
"""A taxel answers to the force if its curve spans so many times the spread of equal trials."""
MOST_FALL = 0.1
"""Largest fall of a curve towards higher forces, a share of its span."""
RESULT, REPORT = "sensor.json", "report.html"
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SensorResponse:
    """The mean readings of all trials of a session on one smooth plate, in order of time.

    ``readings``: float64 (n_trials, n_taxels), mean over a trial in units of ``reading``;
    ``set_g``, ``force_g``, ``speed_mm_s``, ``hours``: float64 (n_trials,), set force, measured mean
    force, speed and time since the first trial; ``repeat``: int64 (n_trials,).
    """

    path: Path
    source: dict[str, Any]
    layout: SensorLayout
    reading: Reading
    readings: Floats
    set_g: Floats
    force_g: Floats
    speed_mm_s: Floats
    hours: Floats
    repeat: NDArray[np.int64]

    @cached_property
    def levels_g(self) -> Floats:
        """Set forces, ascending, float64 (n_levels,)."""
        return np.unique(self.set_g)

    @cached_property
    def measured_g(self) -> Floats:
        """Mean measured force at each set force, float64 (n_levels,)."""
        return self._means(self.force_g[:, None], np.ones(len(self.set_g), bool))[:, 0]

    @cached_property
    def curves(self) -> Floats:
        """Mean reading of each taxel at each set force, float64 (n_levels, n_taxels)."""
        return self._means(self.readings, np.ones(len(self.set_g), bool))

    @cached_property
    def span(self) -> Floats:
        """Range of each taxel's curve, float64 (n_taxels,)."""
        span: Floats = np.ptp(self.curves, axis=0)
        return span

    @cached_property
    def is_rising(self) -> NDArray[np.bool_]:
        """Whether the set force before a trial's was lower, bool (n_trials,)."""
        rising, last = np.ones(len(self.set_g), bool), True
        for row in range(1, len(rising)):
            step_g = self.set_g[row] - self.set_g[row - 1]
            last = bool(step_g > 0) if step_g else last
            rising[row] = last
        return rising

    def curves_of(self, *, rising: bool) -> Floats:
        """Return the curves in one direction of the force, NaN for a level without a trial."""
        return self._means(self.readings, self.is_rising == rising)

    @cached_property
    def hysteresis(self) -> Floats:
        """Mean reading at falling less rising forces, share of the span; NaN without both.

        Positive where a skin is slow to recover.
        """
        apart = self.curves_of(rising=False) - self.curves_of(rising=True)
        both = ~np.isnan(apart).any(axis=1)
        return apart[both].mean(axis=0) / self._width if both.any() else np.nan * self._width

    @cached_property
    def speed_effect(self) -> Floats:
        """Largest difference of a speed's mean from that of all speeds, share of the span."""
        speeds = np.unique(self.speed_mm_s)
        off = [self._residuals[self.speed_mm_s == speed].mean(axis=0) for speed in speeds]
        largest: Floats = np.abs(off).max(axis=0)
        return largest / self._width

    @cached_property
    def repeatability(self) -> Floats:
        """Standard deviation of trials of one force, speed and direction, share of the span.

        NaN where no two trials are alike.
        """
        keys = np.stack([self.set_g, self.speed_mm_s, self.is_rising], axis=1)
        _, cell = np.unique(keys, axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        counts = np.bincount(cell)
        squares, freedom = np.zeros(self.readings.shape[1]), int((counts - 1).sum())
        for number in np.flatnonzero(counts > 1):
            rows = self.readings[cell == number]
            squares += np.square(rows - rows.mean(axis=0)).sum(axis=0)
        if not freedom:
            return np.full(self.readings.shape[1], np.nan)
        deviation: Floats = np.sqrt(squares / freedom)
        return deviation / self._width

    @cached_property
    def drift_per_hour(self) -> Floats:
        """Slope of what the curve leaves over time, share of the span an hour."""
        hours = self.hours - self.hours.mean()
        scatter = float(np.square(hours).sum())
        slopes = hours @ self._residuals / scatter if scatter else np.zeros(len(self.span))
        return slopes / self._width

    @cached_property
    def end_slope(self) -> Floats:
        """Slope of the curve at the highest forces over its steepest: near 0 for a saturated taxel.

        Slopes are taken over a quarter of the levels.
        """
        wide = max(1, len(self.levels_g) // 4)
        rise = (self.curves[wide:] - self.curves[:-wide]).T
        slopes = rise / (self.measured_g[wide:] - self.measured_g[:-wide])
        steepest = slopes.max(axis=1)
        shares: Floats = slopes[:, -1] / np.where(steepest > 0, steepest, np.nan)
        return shares

    @cached_property
    def estimated_g(self) -> Floats:
        """Force that all taxels together show in each trial, float64 (n_trials,).

        The curve is that of the other repeats; of all trials where there is one repeat only.
        """
        estimated_g = np.empty(len(self.set_g))
        for repeat in np.unique(self.repeat):
            here = self.repeat == repeat
            known = ~here if not here.all() else here
            sums = np.fmax.accumulate(self._means(self.readings, known).sum(axis=1))
            forces_g = self._means(self.force_g[:, None], known)[:, 0]
            seen = ~np.isnan(forces_g)
            shown = self.readings[here].sum(axis=1)
            estimated_g[here] = np.interp(shown, sums[seen], forces_g[seen])
        return estimated_g

    @cached_property
    def force_error(self) -> Floats:
        """Root mean square error of the estimated force at each level, share of the force."""
        error = (self.estimated_g - self.force_g) / self.force_g
        return np.sqrt(self._means(np.square(error)[:, None], np.ones(len(error), bool))[:, 0])

    @property
    def findings(self) -> list[str]:
        """Sentences on taxels that do not answer to the force as a pressure sensor does."""
        noise = self.repeatability * self._width
        dead = self.span <= LEAST_SPAN_NOISE * np.nan_to_num(noise)
        falls = np.maximum.accumulate(self.curves) - self.curves
        falling = (falls.max(axis=0) > MOST_FALL * self._width) & ~dead
        found = [
            f"taxel {i + 1} does not answer to the force: its mean reading spans "
            f"{self.span[i]:.0f} {self.reading.unit}, and equal trials differ by {noise[i]:.0f}"
            for i in np.flatnonzero(dead)
        ]
        return found + [
            f"taxel {i + 1} reads less at higher forces: it falls by "
            f"{falls[:, i].max() / self._width[i]:.0%} of its span"
            for i in np.flatnonzero(falling)
        ]

    @cached_property
    def _width(self) -> Floats:
        return np.where(self.span > 0, self.span, np.nan)

    @cached_property
    def _residuals(self) -> Floats:
        level = np.searchsorted(self.levels_g, self.set_g)
        return self.readings - self.curves[level]

    def _means(self, values: Floats, chosen: NDArray[np.bool_]) -> Floats:
        """Return the mean of the chosen rows at each level, NaN for a level without any."""
        out = np.full((len(self.levels_g), values.shape[1]), np.nan)
        for i, level_g in enumerate(self.levels_g):
            rows = values[chosen & (self.set_g == level_g)]
            if len(rows):
                out[i] = rows.mean(axis=0)
        return out


def measure(path: Path, reading: Reading = Reading.CONDUCTANCE) -> SensorResponse:
    """Measure a session on one smooth plate.

    Raises WrongUse for several plates, fewer than :data:`FEWEST_FORCES` forces, or conductances of
    a session whose wiring is not known; SessionError for a session that cannot be read.
    """
    trials = join_sessions([path], reading=reading).without_gaps()
    if len(trials.textures) > 1:
        raise WrongUse(
            f"{path} has the plates {', '.join(trials.textures)}: a taxel's curve needs one smooth "
            "plate, as in protocols/sensor.toml"
        )
    if len(trials.forces_g) < FEWEST_FORCES:
        raise WrongUse(
            f"{path} has {len(trials.forces_g)} forces: a taxel's curve needs {FEWEST_FORCES} or "
            "more, as in protocols/sensor.toml"
        )
    with Session.open(path) as session:
        rows = session.trials[[trial.row for trial in trials.trials]]
    started_s = rows["started_s"].astype(np.float64)
    return SensorResponse(
        path,
        trials.provenance[0],
        trials.sensor_layout,
        reading,
        mean_readings(trials),
        rows["force_g"].astype(np.float64),
        rows["mean_force_g"].astype(np.float64),
        rows["speed_mm_s"].astype(np.float64),
        (started_s - started_s[0]) / 3600.0,
        rows["repeat"].astype(np.int64),
    )


def mean_readings(trials: TrialSet) -> Floats:
    """Return the mean reading of each taxel over each trial, float64 (n_trials, n_taxels)."""
    with open_trials(trials.files) as reader:
        return np.array([reader.read(trial).mean(axis=0) for trial in trials.trials])


def as_dict(found: SensorResponse) -> dict[str, Any]:
    """Return everything as values for JSON; None for a value that was not measured."""
    shares = ("hysteresis", "repeatability", "speed_effect", "drift_per_hour", "end_slope")
    return {
        "session": str(found.path),
        "session_digest": found.source["closing_digest"],
        "simulated": found.source["simulated"],
        "sensor": found.source["sensor"],
        "begun_utc": found.source["begun_utc"],
        "reading": str(found.reading),
        "unit": found.reading.unit,
        "trials": len(found.set_g),
        "force_g": _rounded(found.measured_g, 2),
        "force_error": _rounded(found.force_error, 5),
        "taxels": [
            {
                "taxel": i + 1,
                "curve": _rounded(found.curves[:, i], 2),
                "span": round(float(found.span[i]), 2),
                **{name: _rounded(getattr(found, name)[i : i + 1], 5)[0] for name in shares},
            }
            for i in range(found.readings.shape[1])
        ],
        "findings": found.findings,
    }


def _rounded(values: Floats, digits: int) -> list[float | None]:
    return [round(v, digits) if math.isfinite(v) else None for v in values.tolist()]


def summary_lines(found: SensorResponse) -> list[str]:
    """Return the result in lines: medians over the taxels, the force estimate, and findings."""
    unit, low_g, high_g = found.reading.unit, found.levels_g[0], found.levels_g[-1]
    error = found.force_error
    return [
        f"{len(found.span)} taxels over {low_g:g} to {high_g:g} g, {len(found.set_g)} trials: "
        f"their mean readings span {np.median(found.span):.0f} {unit} (median)",
        f"of that span: hysteresis {_percent(found.hysteresis)}, speed "
        f"{_percent(found.speed_effect)}, repeats ± {_percent(found.repeatability)}, drift "
        f"{_percent(found.drift_per_hour)} an hour; slope at the highest force "
        f"{_percent(found.end_slope)} of the steepest (medians)",
        f"the force that all taxels show is off by {math.sqrt(np.mean(error**2)):.1%} of itself "
        f"(rms), at most by {error.max():.1%}, at {found.levels_g[int(error.argmax())]:g} g",
        *found.findings,
    ]


def _percent(values: Floats) -> str:
    middle = float(np.nanmedian(values)) if not np.isnan(values).all() else math.nan
    return f"{100.0 * middle:.1f} %" if math.isfinite(middle) else "not measured"


def write_report(found: SensorResponse, out: Path) -> Path:
    """Write report.html, sensor.json and the figure to a new folder; return the page.

    Raises WrongUse where ``out`` exists, DiskFault where it cannot be written.
    """
    with atomic_directory(out) as folder:
        values = as_dict(found)
        text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / RESULT).write_text(text + "\n", encoding="utf-8")
        figure = _draw_figure(found, folder / "sensor")
        page = render_page("sensor.html", results=values, lines=summary_lines(found), figure=figure)
        (folder / REPORT).write_text(page, encoding="utf-8")
    return out / REPORT


def _draw_figure(found: SensorResponse, stem: Path) -> Path:
    figure, panels = new_figure((10, 9.6), 2, 2)
    (curves, loop), (estimate, shares) = panels
    _draw_curves(curves, found)
    _draw_loop(loop, found)
    _draw_estimate(estimate, found)
    _draw_shares(shares, found)
    bench = "Simulated bench" if found.source["simulated"] else "Real bench"
    origin = f"{bench} · session {found.path.name} · {len(found.set_g):,} trials on a smooth plate"
    return save_figure(figure, stem, "Sensor", origin)


def _draw_curves(axes: Axes, found: SensorResponse) -> None:
    """Draw each taxel's curve; layers differ in colour and line."""
    styles = ((SA_COLOUR, "-"), (RA_COLOUR, "--"), (MUTED, ":"))
    for layer, name in enumerate(found.layout.layers):
        colour, line = styles[layer % len(styles)]
        for taxel in found.layout.taxels_of(layer):
            axes.plot(found.measured_g, found.curves[:, taxel], line, color=colour, lw=0.9)
        axes.plot([], [], line, color=colour, label=f"layer {name}")
    axes.legend(frameon=False, loc="upper left")
    axes.set(xlabel="force (g)", ylabel=f"mean reading ({found.reading.unit})")
    axes.set_title("Each taxel", loc="left", size=10)


def _draw_loop(axes: Axes, found: SensorResponse) -> None:
    for rising, line, marker in ((True, "-", "^"), (False, "--", "v")):
        sums = found.curves_of(rising=rising).sum(axis=1)
        words = "rising forces" if rising else "falling forces"
        colour = SA_COLOUR if rising else RA_COLOUR
        axes.plot(found.measured_g, sums, line, marker=marker, ms=4, color=colour, label=words)
    axes.legend(frameon=False, loc="upper left")
    axes.set(xlabel="force (g)", ylabel=f"sum of mean readings ({found.reading.unit})")
    axes.set_title("All taxels, forces up and down", loc="left", size=10)


def _draw_estimate(axes: Axes, found: SensorResponse) -> None:
    error = 100.0 * (found.estimated_g / found.force_g - 1.0)
    for speed, marker in zip(np.unique(found.speed_mm_s), "osDv^", strict=False):
        rows = found.speed_mm_s == speed
        axes.plot(
            found.force_g[rows], error[rows], marker, ms=4, mfc="none", label=f"{speed:g} mm/s"
        )
    axes.axhline(0, color=MUTED, lw=1)
    axes.legend(frameon=False, ncols=3, loc="upper left")
    axes.margins(y=0.2)
    axes.set(xlabel="force (g)", ylabel="estimated less measured force (%)")
    axes.set_title("Force estimated from all taxels", loc="left", size=10)


def _draw_shares(axes: Axes, found: SensorResponse) -> None:
    taxels = np.arange(1, len(found.span) + 1)
    for name, marker, words in (
        ("hysteresis", "o", "down less up"),
        ("speed_effect", "s", "speed"),
        ("repeatability", "D", "repeats, SD"),
    ):
        axes.plot(taxels, 100.0 * getattr(found, name), marker, ms=4, mfc="none", label=words)
    axes.plot(taxels, 100.0 * found.drift_per_hour, "x", ms=4, label="drift an hour")
    axes.axhline(0, color=MUTED, lw=1)
    axes.legend(frameon=False, ncols=2, loc="upper left")
    axes.margins(y=0.35)
    axes.set_xticks(taxels[:: max(1, len(taxels) // 9)])
    axes.set(xlabel="taxel", ylabel="share of the taxel's span (%)")
    axes.set_title("Departures from the curve", loc="left", size=10)
