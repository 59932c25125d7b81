"""One taxel's trains at two speeds and two forces, before and after each module.

The paper's claim on one figure: what the speed and the force do to a train, and what is left of it
when time is counted in texture travelled (equation 2) and the SA current has its C (equation 1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from rigctl.analysis.report.figure import Figure, Panel, Raster, Series
from rigctl.analysis.representations import Representation
from rigctl.analysis.study import Findings, Row, Study
from rigctl.analysis.train_distances import scaled_trains
from rigctl.analysis.trial_set import TrialSet, open_trials
from rigctl.errors import WrongUse

PAPER_TEXTURE = "L"
"""Of the paper's Figure 2C."""
SHOWN_MM = 36.0
SMOOTH_MS = 8.0
COLOURS = ("ink", "red", "blue", "green")
RECEPTORS = ("SA", "RA")
NOTE = (
    "Correlation of the mean rates of two conditions, which are smoothed with a Gaussian of "
    f"{SMOOTH_MS:g} ms, over the time that all conditions have; 1: the trains lie on each other. "
    "SA rates are spikes over real time in every representation. Difference: mean absolute "
    "difference of the two rates over their mean."
)
Floats = NDArray[np.float64]


class _Condition(NamedTuple):
    """A speed and a force, with the rows of its trials in the set."""

    speed_mm_s: float
    force_g: float
    rows: tuple[int, ...]
    unit: str

    @property
    def name(self) -> str:
        return f"{self.speed_mm_s:g} mm/s, {self.force_g:g} {self.unit}"


class _Trains(NamedTuple):
    """Trains of one representation: by condition and receptor those of each trial, in ms."""

    representation: Representation
    by_condition: Mapping[tuple[str, str], list[Floats]]
    shown_ms: float
    whole_ms: float


def measure(study: Study) -> Findings:
    """Return the figure, and how well the rates of two conditions agree in each representation.

    Raises WrongUse for a texture or taxel that is not there, and for a single condition.
    """
    trials = study.representations.trials
    texture = shown_texture(study)
    conditions = _conditions(trials, texture)
    taxel = _taxel(study, conditions[0])
    each = [_trains(study, one, conditions, taxel) for one in study.shown]
    rows = [row for one in each for row in _rows(one, conditions, study)]
    sentences = [
        f"Texture {texture}, taxel {taxel + 1}, {' and '.join(_levels(conditions))}.",
        *_sentences(rows, study),
    ]
    return Findings(sentences, rows, [_figure(each, conditions, study, texture, taxel)], NOTE)


def shown_texture(study: Study) -> str:
    """Return the texture of an analysis file, else the paper's or the first.

    Raises WrongUse for one that is not there.
    """
    wanted, trials = study.constants.further.texture, study.representations.trials
    if wanted and wanted not in trials.textures:
        raise WrongUse(f"there is no texture {wanted}: choose from {', '.join(trials.textures)}")
    usual = PAPER_TEXTURE if PAPER_TEXTURE in trials.textures else trials.textures[0]
    return wanted or usual


def _conditions(trials: TrialSet, texture: str) -> list[_Condition]:
    """Return the slowest and the fastest speed with the lowest and the highest force."""
    mine = [row for row, trial in enumerate(trials.trials) if trial.texture == texture]
    speeds = sorted({trials.trials[row].speed_mm_s for row in mine})
    forces = sorted({trials.trials[row].force_g for row in mine})
    ends = [list(dict.fromkeys((one[0], one[-1]))) for one in (speeds, forces)]
    found = []
    for speed, force in product(*ends):
        rows = tuple(
            row
            for row in mine
            if (trials.trials[row].speed_mm_s, trials.trials[row].force_g) == (speed, force)
        )
        if rows:
            found.append(_Condition(speed, force, rows, trials.press_unit))
    if len(found) < 2:
        raise WrongUse(f"texture {texture} has a single speed and force: nothing is to compare")
    return found


def _taxel(study: Study, condition: _Condition) -> int:
    """Return the chosen taxel from 0, or that with the largest deviation in the first trial."""
    wanted, found = study.constants.further.taxel, study.representations
    n = found.trials.n_taxels
    if wanted > n:
        raise WrongUse(f"there is no taxel {wanted}: choose 1 to {n}")
    if wanted:
        return wanted - 1
    with open_trials(found.trials.files) as reader:
        samples = reader.read(found.trials.trials[condition.rows[0]])
    return int(found.normalisation.apply(samples).std(axis=0).argmax())


def _trains(
    study: Study, one: Representation, conditions: Sequence[_Condition], taxel: int
) -> _Trains:
    n, trials = study.representations.trials.n_taxels, study.representations.trials.trials
    reference = study.constants.windows.reference_speed_mm_s
    found: dict[tuple[str, str], list[Floats]] = {}
    whole = []
    for condition in conditions:
        table = scaled_trains(study, one, np.array(condition.rows, np.intp))
        for number, receptor in enumerate(RECEPTORS):
            train = number * n + taxel
            found[condition.name, receptor] = [
                table.ms[table.ptr[i, train] : table.ptr[i, train + 1]]
                for i in range(len(condition.rows))
            ]
        factor = condition.speed_mm_s / reference if one.speed_scaled else 1.0
        whole.append(min(trials[row].n_samples for row in condition.rows) * factor)
    slowest = reference if one.speed_scaled else min(each.speed_mm_s for each in conditions)
    shown_ms = min(1000 * SHOWN_MM / slowest, max(whole))
    return _Trains(one, found, shown_ms, min(whole))


def _rate_hz(
    trains: _Trains, condition: _Condition, receptor: str, until_ms: float, reference: float
) -> Floats:
    """Return the mean rate of a condition's trials at each ms, smoothed, float64 (n,), Hz.

    SA rates are over real time, as the paper normalises them; RA spikes over the time shown.
    """
    n = max(1, int(until_ms))
    each = trains.by_condition[condition.name, receptor]
    counts = np.zeros(n)
    for train in each:
        counts += np.bincount(train[train < n].astype(np.int64), minlength=n)
    factor = 1.0
    if trains.representation.speed_scaled and receptor == "SA":
        factor = condition.speed_mm_s / reference
    rate: Floats = gaussian_filter1d(1000 * factor * counts / len(each), SMOOTH_MS)
    return rate


def _rows(trains: _Trains, conditions: Sequence[_Condition], study: Study) -> list[Row]:
    reference = study.constants.windows.reference_speed_mm_s
    rows: list[Row] = []
    for receptor in RECEPTORS:
        rates = {
            one: _rate_hz(trains, one, receptor, trains.whole_ms, reference) for one in conditions
        }
        for one, other in combinations(conditions, 2):
            a, b = rates[one], rates[other]
            varies = a.std() > 0 and b.std() > 0
            mean = (a.mean() + b.mean()) / 2
            rows.append(
                {
                    "representation": trains.representation.name,
                    "receptor": receptor,
                    "condition": one.name,
                    "other_condition": other.name,
                    "rate_hz": round(float(a.mean()), 3),
                    "other_rate_hz": round(float(b.mean()), 3),
                    "correlation": round(float(np.corrcoef(a, b)[0, 1]), 4) if varies else None,
                    "difference_percent": round(100 * float(np.abs(a - b).mean() / mean), 2)
                    if mean
                    else None,
                }
            )
    return rows


def _levels(conditions: Sequence[_Condition]) -> list[str]:
    speeds = dict.fromkeys(f"{one.speed_mm_s:g}" for one in conditions)
    forces = dict.fromkeys(f"{one.force_g:g}" for one in conditions)
    return [f"{', '.join(speeds)} mm/s", f"{', '.join(forces)} {conditions[0].unit}"]


def _sentences(rows: Sequence[Row], study: Study) -> list[str]:
    """Return the mean agreement of two conditions in each representation."""
    parts = []
    for one in study.shown:
        mine = [r for r in rows if (r["representation"], r["receptor"]) == (one.name, "SA")]
        known = [row["correlation"] for row in mine if row["correlation"] is not None]
        apart = [row["difference_percent"] for row in mine if row["difference_percent"] is not None]
        if known and apart:
            parts.append(f"{one.name} {np.mean(known):.2f} and {np.mean(apart):.0f} %")
    return [f"Mean correlation and difference of SA rates of two conditions: {'; '.join(parts)}."]


def _figure(
    each: Sequence[_Trains],
    conditions: Sequence[_Condition],
    study: Study,
    texture: str,
    taxel: int,
) -> Figure:
    """Return the rasters of one trial a condition, and below them the mean SA rates."""
    reference = study.constants.windows.reference_speed_mm_s
    panels: list[Panel | Raster] = [_raster(trains, conditions) for trains in each]
    rates = [
        [_rate_hz(one, each_of, "SA", one.shown_ms, reference) for each_of in conditions]
        for one in each
    ]
    highest = 1.05 * max(float(rate.max()) for some in rates for rate in some) or 1.0
    for trains, some in zip(each, rates, strict=True):
        series = [
            Series(one.name, colour, list(range(len(rate))), rate.tolist())
            for one, colour, rate in zip(conditions, COLOURS, some, strict=False)
        ]
        label, ends = _label(trains), (0.0, trains.shown_ms)
        title = f"{trains.representation.name}: mean SA rate"
        panels.append(Panel(title, series, label, "rate (Hz)", ends, (0.0, highest), unit="Hz"))
    notes = [
        f"Texture {texture}, taxel {taxel + 1}: SA and RA of one trial a condition, from its "
        f"start; below, the smoothed mean SA rate of its trials over real time ({SMOOTH_MS:g} ms).",
        f"Scaled time is that at {reference:g} mm/s: the first {SHOWN_MM:g} mm of the texture.",
    ]
    return Figure("One taxel before and after each module", panels, notes, columns=len(each))


def _label(trains: _Trains) -> str:
    return "scaled time (ms)" if trains.representation.speed_scaled else "time (ms)"


def _raster(trains: _Trains, conditions: Sequence[_Condition]) -> Raster:
    names = [f"{receptor} {one.name}" for receptor in RECEPTORS for one in conditions]
    series = []
    for row, (receptor, (one, colour)) in enumerate(
        product(RECEPTORS, list(zip(conditions, COLOURS, strict=False)))
    ):
        times = trains.by_condition[one.name, receptor][0].tolist()
        series.append(Series(one.name, colour, times, [float(row)] * len(times)))
    ends = (0.0, trains.shown_ms)
    return Raster(trains.representation.name, names, series, _label(trains), ends)
