"""How far trains are apart within and between textures and conditions, and nearest neighbours.

The trials are drawn, because all pairs of a large set cannot be had. No features are involved:
trains of the four representations are those of the encoder, with their times in ms, or in ms of
texture travelled at the reference speed, and with or without C.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.report.figure import Bars, Figure, Series
from rigctl.analysis.representations import REPRESENTATIONS, Representation
from rigctl.analysis.spike_counts import c_per_trial
from rigctl.analysis.spike_distances import TrainTable, van_rossum, victor_purpura
from rigctl.analysis.statistics import wilson_interval
from rigctl.analysis.study import COLOURS, Findings, Row, Study, percent
from rigctl.analysis.trial_set import Design, open_trials
from rigctl.encoder.encoder import encode_trials
from rigctl.errors import WrongUse

STAGE = "distances of spike trains"
VICTOR_PURPURA, VAN_ROSSUM = "Victor-Purpura", "van Rossum"
BLOCK = 10
"""Rows of a matrix of distances that one task computes."""
NOTE = (
    "Mean distance of two trials over all their trains (Victor-Purpura: sum; van Rossum: root of "
    "the sum of squares), of the same texture or another, in the same speed and force or another. "
    "Contrast: the distance between textures over that within a texture, both in other conditions; "
    "1: the trains do not tell textures apart across conditions. Nearest neighbours: share of "
    "trials whose neighbours have their texture, among all other trials, among those at another "
    "speed, and among those at another force, with the 95 % Wilson interval in brackets."
)
Floats = NDArray[np.float64]


class _Job(NamedTuple):
    trains: Path
    rows: range
    cost_per_ms: float
    tau_ms: float


class _Pairs(NamedTuple):
    """Masks over pairs of two different trials, bool (n, n) each."""

    same_texture: NDArray[np.bool_]
    same_condition: NDArray[np.bool_]
    other_speed: NDArray[np.bool_]
    other_force: NDArray[np.bool_]
    two: NDArray[np.bool_]


def measure(study: Study) -> Findings:
    """Return distances and neighbours of the drawn trials.

    Raises WrongUse for fewer than two textures with two trials.
    """
    further = study.constants.further
    rows = draw_trials(study.design, further.distance_trials, study.settings.seed)
    drawn = _drawn_design(study.design, rows)
    if len(drawn.textures) < 2 or len(rows) < 4:
        raise WrongUse("it needs two textures or more, with two trials or more")
    pairs, table = _pairs(drawn), []
    with study.part() as folder:
        for one in study.shown:
            matrices = _distances(study, one, rows, folder)
            for name, distances in matrices.items():
                table.append(_row(one.name, name, distances, drawn, pairs, further.neighbours))
    first = (
        f"{len(rows)} of {len(study.design.texture)} trials, drawn evenly; a spike is moved "
        f"{1000 / further.shift_cost_per_s:g} ms at the cost of adding one, and van Rossum's time "
        f"constant is {further.time_constant_ms:g} ms."
    )
    sentences = [_sentence(row) for row in table if row["contrast"] is not None]
    return Findings([first, *sentences], table, _figures(table), NOTE)


def _sentence(row: Row) -> str:
    found = row["neighbours_other_speed_percent"]
    across = (
        ""
        if found is None
        else f"; {found:.0f} % find their texture in neighbours at another speed"
    )
    return (
        f"{row['representation']}, {row['distance']}: trials of two textures are "
        f"{row['contrast']:.2f} times as far apart as those of one, in other conditions{across}."
    )


def draw_trials(design: Design, n_trials: int, seed: int) -> NDArray[np.intp]:
    """Return the rows of at most so many trials: two of each condition, then two more, and so on.

    In twos, because distances within a condition need two of its trials.
    """
    random = np.random.default_rng([seed, 36])
    conditions = [random.permutation(rows) for rows in design.conditions()]
    order = random.permutation(len(conditions))
    turns = range(0, max(map(len, conditions)), 2)
    taken = [row for at in turns for i in order for row in conditions[i][at : at + 2]]
    return np.sort(np.array(taken[:n_trials], np.intp))


def _drawn_design(design: Design, rows: NDArray[np.intp]) -> Design:
    present, texture = np.unique(design.texture[rows], return_inverse=True)
    names = tuple(design.textures[label] for label in present.tolist())
    return Design(names, texture.reshape(-1), design.speed_mm_s[rows], design.force_g[rows])


def _pairs(design: Design) -> _Pairs:
    def same(values: NDArray[np.generic]) -> NDArray[np.bool_]:
        return np.asarray(values[:, None] == values)

    two = ~np.eye(len(design.texture), dtype=bool)
    speed, force = same(design.speed_mm_s), same(design.force_g)
    return _Pairs(same(design.texture), speed & force, ~speed & two, ~force & two, two)


def _distances(
    study: Study, one: Representation, rows: NDArray[np.intp], folder: Path
) -> dict[str, Floats]:
    """Return the matrices of both distances between the drawn trials in one representation."""
    further = study.constants.further
    table = scaled_trains(study, one, rows)
    path = folder / f"trains-{one.key}.npz"
    np.savez(path, ms=table.ms, ptr=table.ptr)
    numbers = (further.shift_cost_per_s / 1000, further.time_constant_ms)
    jobs = [
        _Job(path, range(at, min(at + BLOCK, len(rows))), *numbers)
        for at in range(0, len(rows), BLOCK)
    ]
    found = list(study.resources.map(_measure_rows, jobs, f"{STAGE}, {one.name}"))
    names = (VICTOR_PURPURA, VAN_ROSSUM)
    return {name: np.concatenate([both[i] for both in found]) for i, name in enumerate(names)}


def scaled_trains(study: Study, one: Representation, rows: NDArray[np.intp]) -> TrainTable:
    """Return the trains of some trials as a representation has them, before any window."""
    found = study.representations
    trials = [found.trials.trials[row] for row in rows.tolist()]
    with open_trials(found.trials.files) as reader:
        samples = [reader.read(trial) for trial in trials]
    scale = None
    if one.force and found.force is not None:
        scale = c_per_trial(trials, found.force, blind=one.force == "blind")
    spikes = encode_trials(samples, found.normalisation, found.parameters, sa_scale=scale)
    reference = study.constants.windows.reference_speed_mm_s
    each = []
    for of_trial, trial in zip(spikes, trials, strict=True):
        factor = trial.speed_mm_s / reference if one.speed_scaled else 1.0
        trains = [of_trial.train(row).astype(np.float64) for row in range(of_trial.n_trains)]
        each.append([factor * train for train in trains])
    return TrainTable.of(each)


def _measure_rows(job: _Job) -> tuple[Floats, Floats]:
    with np.load(job.trains) as file:
        table = TrainTable(file["ms"], file["ptr"])
    return (
        victor_purpura(table, job.rows, job.cost_per_ms),
        van_rossum(table, job.rows, job.tau_ms),
    )


def _row(
    name: str, distance: str, distances: Floats, design: Design, pairs: _Pairs, neighbours: int
) -> Row:
    same, condition, two = pairs.same_texture, pairs.same_condition, pairs.two
    means = {
        "same_texture_same_condition": _mean(distances, same & condition & two),
        "same_texture_other_condition": _mean(distances, same & ~condition),
        "other_texture_same_condition": _mean(distances, ~same & condition),
        "other_texture_other_condition": _mean(distances, ~same & ~condition),
    }
    within, between = (means[f"{which}_texture_other_condition"] for which in ("same", "other"))
    contrast = round(between / within, 4) if within and between is not None else None
    row: dict[str, Any] = {"representation": name, "distance": distance, **means}
    row["contrast"] = contrast
    for key, allowed in (
        ("neighbours", two),
        ("neighbours_other_speed", pairs.other_speed),
        ("neighbours_other_force", pairs.other_force),
    ):
        right, tested = _neighbours_right(distances, design.texture, allowed, neighbours)
        row[f"{key}_percent"] = row[f"{key}_interval"] = None
        if tested:
            low, high = wilson_interval(right, tested)
            row[f"{key}_percent"] = percent(right / tested)
            row[f"{key}_interval"] = f"{100 * low:.1f}–{100 * high:.1f}"
    return row


def _mean(distances: Floats, chosen: NDArray[np.bool_]) -> float | None:
    return round(float(distances[chosen].mean()), 4) if chosen.any() else None


def _neighbours_right(
    distances: Floats, texture: NDArray[np.int64], allowed: NDArray[np.bool_], neighbours: int
) -> tuple[int, int]:
    """Return how many trials their neighbours name right, and how many have any."""
    from sklearn.neighbors import KNeighborsClassifier

    has_its_own = (allowed & (texture[:, None] == texture)).any(axis=1)
    if not has_its_own.any():
        return 0, 0
    k = int(min(neighbours, allowed[has_its_own].sum(axis=1).min()))
    far = 1.0 + 1e6 * float(distances.max())
    knn = KNeighborsClassifier(k, metric="precomputed").fit(distances, texture)
    found = knn.predict(np.where(allowed, distances, far)[has_its_own])
    return int((found == texture[has_its_own]).sum()), int(has_its_own.sum())


def _figures(rows: Sequence[Row]) -> list[Figure]:
    """Return the distances as shares of that between textures, and the neighbours."""
    groups = {
        "same texture, same condition": "same_texture_same_condition",
        "same texture, other condition": "same_texture_other_condition",
        "other texture, same condition": "other_texture_same_condition",
        "other texture, other condition": "other_texture_other_condition",
    }
    found = {
        "neighbours among all trials": "neighbours_percent",
        "at another speed": "neighbours_other_speed_percent",
        "at another force": "neighbours_other_force_percent",
    }
    panels = []
    for name in (VICTOR_PURPURA, VAN_ROSSUM):
        mine = [row for row in rows if row["distance"] == name]
        shares = [_series(row, groups, row["other_texture_other_condition"]) for row in mine]
        label = "distance (% of that of other textures in other conditions)"
        panels.append(Bars(name, list(groups), shares, label, (0.0, 120.0)))
        right = [_series(row, found, 100.0) for row in mine]
        panels.append(Bars(f"{name}: nearest neighbours", list(found), right, "%", (0.0, 100.0)))
    note = "Trials drawn evenly from the conditions; all trains together; no features."
    return [Figure("Distances of spike trains", panels, [note], columns=2)]


def _series(row: Row, columns: dict[str, str], whole: float | None) -> Series:
    """Return the values of a row in per cent of ``whole``; those that are absent are left out."""
    places = [i for i, key in enumerate(columns.values()) if row[key] is not None]
    keys = list(columns.values())
    kind = next(one for one in REPRESENTATIONS if one.name == row["representation"])
    values = [100.0 * float(row[keys[i]]) / (whole or 1.0) for i in places]
    return Series(kind.name, COLOURS[kind.key], places, values)
