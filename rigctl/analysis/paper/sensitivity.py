"""Sensitivity of the results to the encoder's scheme: every preset on the same trials and splits.

The neuron's equations leave the integration open, and each scheme has other rates. The table shows
the effect on accuracies, with few components, so that it costs little more than the encoding.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rigctl.analysis.data.cache import Resources
from rigctl.analysis.data.trial_set import TrialSet
from rigctl.analysis.execution.executor import Progress
from rigctl.analysis.features.representations import Representation, RepresentationSet, represent
from rigctl.analysis.features.spike_counts import RangesOver
from rigctl.analysis.features.transferred_c import ForceMatrixSource
from rigctl.analysis.paper.tasks import Curve, SweepSettings, TaskResult, run_tasks
from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import PRESETS

PRESET_ORDER = ("default", "izhikevich2003", "explicit", "iskarous2022", "quarter-rate")
COMPONENTS = 10
STAGE = "sensitivity over encoder presets"
STAGES_PER_PRESET = 4
STEPS = 100
ROWS_AT_ONCE = 256

Analysed = tuple[RepresentationSet, Sequence[TaskResult]]


class SensitivityRow(NamedTuple):
    """The row of one preset, representation and task; rates are means over trials and taxels."""

    preset: str
    representation: str
    sa_hz: float
    ra_hz: float
    task: str
    components: int
    mean_percent: float
    sd_percent: float | None
    iterations: int


def compare_presets(
    trials: TrialSet,
    base: Analysed,
    settings: SweepSettings,
    folder: Path,
    *,
    reference_g: float,
    source: ForceMatrixSource | None = None,
    ranges: RangesOver | Normalisation = RangesOver.ALL,
    resources: Resources,
) -> list[SensitivityRow]:
    """Return a row for each preset, representation and task; ``base``: results of its own preset.

    Draws and folds are those of ``settings``, so all presets classify the same trials. ``folder``
    holds the feature files of one preset at a time.
    """
    limited = replace(settings, k_max=min(COMPONENTS, settings.k_max))
    rows: list[SensitivityRow] = []
    number, progress = 0, resources.progress
    presets = sum(PRESETS[name] != base[0].parameters for name in PRESET_ORDER)
    for name in PRESET_ORDER:
        if PRESETS[name] == base[0].parameters:
            rows += _preset_rows(name, *base)
            continue
        part = folder / name
        part.mkdir()
        shown = _PresetProgress(number, presets, progress).show
        preset_resources, number = replace(resources, progress=shown), number + 1
        representations = represent(
            trials,
            PRESETS[name],
            part,
            reference_g=reference_g,
            source=source,
            ranges=ranges,
            resources=preset_resources,
        )
        results, _ = run_tasks(representations, limited, preset_resources)
        rows += _preset_rows(name, representations, results)
        shutil.rmtree(part)
    progress(STAGE, STEPS * presets, STEPS * presets)
    return rows


class _PresetProgress:
    """Progress of one preset as a share of all presets, for the time left over all of them."""

    def __init__(self, number: int, presets: int, progress: Progress) -> None:
        self._number, self._presets = number, presets
        self._progress = progress
        self._stages: list[str] = []

    def show(self, stage: str, done: int, total: int) -> None:
        """Report a step of a stage of this preset."""
        if stage not in self._stages:
            self._stages.append(stage)
        before = self._stages.index(stage)
        within = (before + done / max(total, 1)) / max(STAGES_PER_PRESET, len(self._stages))
        self._progress(STAGE, int(STEPS * (self._number + within)), STEPS * self._presets)


def mean_rates_hz(
    representations: RepresentationSet, representation: Representation
) -> tuple[float, float]:
    """Return the mean SA and RA rate over trials and taxels, from a representation's features."""
    features = representations.features(representation)
    layout = representations.scaled if representation.speed_scaled else representations.unscaled
    n, trials = representations.trials.n_taxels, representations.trials.trials
    sa, ra = np.zeros(len(trials)), np.zeros(len(trials))
    seconds = _window_durations_s(representations, layout)
    for start in range(0, len(trials), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        values = np.asarray(features[rows]).reshape(-1, 2 * n, layout.n_windows)
        total = seconds[rows].sum(axis=1)
        sa[rows] = (values[:, :n] * seconds[rows, None]).sum(axis=2).mean(axis=1) / total
        ra[rows] = values[:, n:].sum(axis=2).mean(axis=1) / total
    return float(sa.mean()), float(ra.mean())


def _window_durations_s(
    representations: RepresentationSet, layout: FeatureLayout
) -> np.ndarray[Any, Any]:
    """Return the time of each trial in each window, float64 (trials, windows)."""
    durations: dict[tuple[int, float], Any] = {}
    for trial in representations.trials.trials:
        key = (trial.n_planned, trial.speed_mm_s)
        if key not in durations:
            durations[key] = layout.window_durations_s(*key)
    return np.array([durations[t.n_planned, t.speed_mm_s] for t in representations.trials.trials])


def as_dict(rows: Sequence[SensitivityRow]) -> dict[str, Any] | None:
    """Return the table for ``results.json``, None without rows."""
    if not rows:
        return None
    return {"components": COMPONENTS, "rows": [row._asdict() for row in rows]}


def _preset_rows(
    preset: str, representations: RepresentationSet, results: Sequence[TaskResult]
) -> list[SensitivityRow]:
    rows = []
    for representation in representations.present:
        rates = mean_rates_hz(representations, representation)
        for result in results:
            curve = result.curve(representation.key)
            if curve is not None:
                rows.append(_make_row(preset, rates, result, curve))
    return rows


def _make_row(
    preset: str, rates: tuple[float, float], result: TaskResult, curve: Curve
) -> SensitivityRow:
    k = min(COMPONENTS, result.k_max)
    sd = None if curve.sd is None else round(100 * float(curve.sd[k - 1]), 4)
    mean = round(100 * float(curve.mean[k - 1]), 4)
    sa_hz, ra_hz = (round(rate, 4) for rate in rates)
    key, draws = curve.representation.key, len(curve.accuracy)
    return SensitivityRow(preset, key, sa_hz, ra_hz, result.task.key, k, mean, sd, draws)
