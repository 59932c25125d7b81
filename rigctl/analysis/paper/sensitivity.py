"""How much the encoder's scheme matters: every preset over the same trials and splits.

The neuron's equations leave the integration open, and each scheme has other rates. The table says
what that does to the answers, with few components, so that it costs little more than the encoding.
"""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Mapping, Sequence
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

ORDER = ("default", "izhikevich2003", "explicit", "iskarous2022", "quarter-rate")
COMPONENTS = 10
STAGE = "sensitivity over encoder presets"
STAGES_OF_A_PRESET = 4
STEPS = 100
ROWS_AT_ONCE = 256
COLUMNS = (
    "preset", "representation", "sa_hz", "ra_hz", "task", "components", "mean_percent",
    "sd_percent", "iterations",
)  # fmt: skip

Analysed = tuple[RepresentationSet, Sequence[TaskResult]]


class SensitivityRow(NamedTuple):
    """One preset, representation and task. Rates are means over trials and taxels."""

    preset: str
    representation: str
    sa_hz: float
    ra_hz: float
    task: str
    components: int
    mean_percent: float
    sd_percent: float | None
    iterations: int


def sensitivity(
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
    """A line for each preset, representation and task; ``base`` stands for its own preset.

    Draws and folds are those of ``settings``, so all presets answer the same questions. Feature
    files lie in ``folder`` one preset at a time.
    """
    mine = replace(settings, k_max=min(COMPONENTS, settings.k_max))
    lines, number = [], 0
    executor, progress = resources.executor, resources.progress
    presets = sum(PRESETS[name] != base[0].parameters for name in ORDER)
    for name in ORDER:
        if PRESETS[name] == base[0].parameters:
            lines += _lines(name, *base)
            continue
        part = folder / name
        part.mkdir()
        share, number = _PresetShare(number, presets, progress), number + 1
        made = represent(
            trials,
            PRESETS[name],
            part,
            reference_g=reference_g,
            source=source,
            ranges=ranges,
            resources=replace(resources, progress=share.show),
        )
        lines += _lines(
            name, made, run_tasks(made, mine, executor=executor, progress=share.show)[0]
        )
        shutil.rmtree(part)
    progress(STAGE, STEPS * presets, STEPS * presets)
    return lines


class _PresetShare:
    """The stages of one preset as a part of all presets, so that the time left is that of all."""

    def __init__(self, number: int, presets: int, progress: Progress) -> None:
        self._number, self._presets = number, presets
        self._progress = progress
        self._seen: list[str] = []

    def show(self, stage: str, done: int, all_: int) -> None:
        """One step of a stage of this preset."""
        if stage not in self._seen:
            self._seen.append(stage)
        before = self._seen.index(stage)
        within = (before + done / max(all_, 1)) / max(STAGES_OF_A_PRESET, len(self._seen))
        self._progress(STAGE, int(STEPS * (self._number + within)), STEPS * self._presets)


def mean_rates_hz(made: RepresentationSet, representation: Representation) -> tuple[float, float]:
    """Mean SA and RA rate over trials and taxels, out of a representation's features."""
    features = made.features(representation)
    layout = made.scaled if representation.speed_scaled else made.unscaled
    n, trials = made.trials.n_taxels, made.trials.trials
    sa, ra = np.zeros(len(trials)), np.zeros(len(trials))
    seconds = _seconds(made, layout)
    for start in range(0, len(trials), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        values = np.asarray(features[rows]).reshape(-1, 2 * n, layout.n_windows)
        total = seconds[rows].sum(axis=1)
        sa[rows] = (values[:, :n] * seconds[rows, None]).sum(axis=2).mean(axis=1) / total
        ra[rows] = values[:, n:].sum(axis=2).mean(axis=1) / total
    return float(sa.mean()), float(ra.mean())


def _seconds(made: RepresentationSet, layout: FeatureLayout) -> np.ndarray[Any, Any]:
    """Time that each trial spends in each window, float64 (trials, windows)."""
    known: dict[tuple[int, float], Any] = {}
    for trial in made.trials.trials:
        key = (trial.n_planned, trial.speed_mm_s)
        if key not in known:
            known[key] = layout.window_durations_s(*key)
    return np.array([known[t.n_planned, t.speed_mm_s] for t in made.trials.trials])


def as_plain(lines: Sequence[SensitivityRow]) -> dict[str, Any] | None:
    """For ``results.json``; None where no table was asked for."""
    if not lines:
        return None
    return {"components": COMPONENTS, "rows": [line._asdict() for line in lines]}


def as_csv(plain: Mapping[str, Any]) -> str:
    """The table of :func:`as_plain` as CSV; what is not known is empty."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(plain["rows"])
    return out.getvalue()


def _lines(
    preset: str, made: RepresentationSet, results: Sequence[TaskResult]
) -> list[SensitivityRow]:
    lines = []
    for representation in made.present:
        rates = mean_rates_hz(made, representation)
        for result in results:
            curve = result.curve(representation.key)
            if curve is not None:
                lines.append(_line(preset, rates, result, curve))
    return lines


def _line(
    preset: str, rates: tuple[float, float], result: TaskResult, curve: Curve
) -> SensitivityRow:
    k = min(COMPONENTS, result.k_max)
    sd = None if curve.deviation is None else round(100 * float(curve.deviation[k - 1]), 4)
    mean = round(100 * float(curve.mean[k - 1]), 4)
    sa_hz, ra_hz = (round(rate, 4) for rate in rates)
    key, draws = curve.representation.key, len(curve.accuracy)
    return SensitivityRow(preset, key, sa_hz, ra_hz, result.task.key, k, mean, sd, draws)
