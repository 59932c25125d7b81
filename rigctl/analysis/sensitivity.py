"""Sensitivity of the results to the encoder's scheme: every preset on the same trials and splits.

The neuron's equations leave the integration open, and each scheme has other rates. The paper leaves
order, phase and unit of the RA channel's filter open too. The table shows the effect on accuracies,
with few components, so that it costs little more than the encoding.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.analysis.cache import Resources
from rigctl.analysis.executors import Progress
from rigctl.analysis.further_tasks import TASKS
from rigctl.analysis.representations import REPRESENTATIONS, Representation, RepresentationSet
from rigctl.analysis.tasks import Curve, SweepSettings, TaskResult, run_tasks
from rigctl.encoder.parameters import MODEL_PRESETS, PRESETS, SA_PRESETS

_NEURONS = (*SA_PRESETS, *MODEL_PRESETS)
PRESET_ORDER = (*_NEURONS, *(name for name in PRESETS if name not in _NEURONS))
"""Those that differ in the neuron, then the readings of the RA channel."""
RA_PRESETS = ("default", *PRESET_ORDER[len(_NEURONS) :])
GROUPS = {
    "presets that differ in the neuron": SA_PRESETS,
    "neurons": ("default", *MODEL_PRESETS),
    "readings of the RA channel": RA_PRESETS,
}
COMPONENTS = 10
STAGE = "sensitivity over encoder presets"
STAGES_PER_PRESET = 6
STEPS = 100
ROWS_AT_ONCE = 256
Row = dict[str, Any]
"""One preset, representation and task; rates are means over trials and taxels."""
Analysed = tuple[RepresentationSet, Sequence[TaskResult]]


def compare_presets(
    encode: Callable[..., RepresentationSet],
    base: Analysed,
    settings: SweepSettings,
    folder: Path,
    resources: Resources,
) -> list[Row]:
    """Return a row for each preset, representation and task.

    ``encode``: :func:`represent` for the trials; it still takes parameters, folder and resources.
    ``base``: the results of its own preset. Draws and folds are those of ``settings``, so all
    presets classify the same trials. ``folder`` holds the feature files of one preset at a time.
    """
    limited = replace(settings, k_max=min(COMPONENTS, settings.k_max))
    reading = base[0].parameters.reading
    presets = {name: replace(PRESETS[name], reading=reading) for name in PRESET_ORDER}
    others = [name for name in PRESET_ORDER if presets[name] != base[0].parameters]
    rows: list[Row] = []
    for name in PRESET_ORDER:
        if name not in others:
            rows += _preset_rows(name, *base)
            continue
        part = folder / name
        part.mkdir()
        progress = _share_progress(others.index(name), len(others), resources.progress)
        preset_resources = replace(resources, progress=progress)
        representations = encode(presets[name], part, resources=preset_resources)
        results, _ = run_tasks(representations, limited, preset_resources)
        rows += _preset_rows(name, representations, results)
        shutil.rmtree(part)
    resources.progress(STAGE, STEPS * len(others), STEPS * len(others))
    return rows


def _share_progress(number: int, presets: int, progress: Progress) -> Progress:
    """Return a callback that reports one preset's progress as a share of that of all presets."""
    stages: list[str] = []

    def show(stage: str, done: int, total: int) -> None:
        if stage not in stages:
            stages.append(stage)
        within = (stages.index(stage) + done / max(total, 1)) / max(STAGES_PER_PRESET, len(stages))
        progress(STAGE, int(STEPS * (number + within)), STEPS * presets)

    return show


def mean_rates_hz(
    representations: RepresentationSet, representation: Representation
) -> tuple[float, float]:
    """Return the mean SA and RA rate over trials and taxels, from a representation's features."""
    features = representations.features(representation)
    layout = representations.layout(representation)
    n, trials = representations.trials.n_taxels, representations.trials.trials
    sa, ra = np.zeros(len(trials)), np.zeros(len(trials))
    durations_s = cache(layout.window_durations_s)
    seconds = np.array([durations_s(trial.n_planned, trial.speed_mm_s) for trial in trials])
    for start in range(0, len(trials), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        values = np.asarray(features[rows]).reshape(-1, 2 * n, layout.n_windows)
        total = seconds[rows].sum(axis=1)
        sa[rows] = (values[:, :n] * seconds[rows, None]).sum(axis=2).mean(axis=1) / total
        ra[rows] = values[:, n:].sum(axis=2).mean(axis=1) / total
    return float(sa.mean()), float(ra.mean())


def as_dict(rows: Sequence[Row]) -> dict[str, Any] | None:
    """Return the table for ``results.json``, None without rows."""
    if not rows:
        return None
    sentences = [_spread_sentence(rows, what, names) for what, names in GROUPS.items()]
    return {"components": COMPONENTS, "sentences": sentences, "rows": list(rows)}


def _spread_sentence(rows: Sequence[Row], what: str, presets: Sequence[str]) -> str:
    """Return a sentence on how far the accuracies of some presets are apart."""
    by_case: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        if row["preset"] in presets:
            case = row["representation"], row["task"]
            by_case.setdefault(case, []).append(row["mean_percent"])
    ranges = {case: (min(values), max(values)) for case, values in by_case.items()}
    widths = {case: high - low for case, (low, high) in ranges.items()}
    widest = max(widths, key=widths.__getitem__)
    names = {r.key: r.name for r in REPRESENTATIONS}
    titles = {task.key: task.title for task in TASKS}
    low, high = ranges[widest]
    return (
        f"Between the {len(presets)} {what}, an accuracy differs by "
        f"{np.mean(list(widths.values())):.1f} percentage points on average over representations "
        f"and tasks, at most by {widths[widest]:.1f} ({names[widest[0]]}, "
        f"{titles.get(widest[1], widest[1]).lower()}: {low:.1f} to {high:.1f} %)"
    )


def _preset_rows(
    preset: str, representations: RepresentationSet, results: Sequence[TaskResult]
) -> list[Row]:
    rows = []
    for representation in representations.present:
        rates_hz = [round(rate, 4) for rate in mean_rates_hz(representations, representation)]
        for result in results:
            curve = result.curve(representation.key)
            if curve is not None:
                rows.append(_make_row(preset, rates_hz, result, curve))
    return rows


def _make_row(preset: str, rates_hz: Sequence[float], result: TaskResult, curve: Curve) -> Row:
    k = min(COMPONENTS, result.k_max)
    return {
        "preset": preset,
        "representation": curve.representation.key,
        "sa_hz": rates_hz[0],
        "ra_hz": rates_hz[1],
        "task": result.task.key,
        "components": k,
        "mean_percent": round(100 * float(curve.mean[k - 1]), 4),
        "sd_percent": None if curve.sd is None else round(100 * float(curve.sd[k - 1]), 4),
        "iterations": len(curve.accuracy),
    }
