"""Every stage of the paper's Figure 1B for one trial, from its readings to the texture named.

The trial is one that the report's first draw tests, so its classifier has not seen it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.invariance import RECEPTORS, shown_texture
from rigctl.analysis.pca_lda import Split, fit_classifier, log_posteriors
from rigctl.analysis.report.figure import Bars, Figure, Image, Raster, Series, Traces
from rigctl.analysis.representations import Representation
from rigctl.analysis.spike_counts import c_per_trial
from rigctl.analysis.splits import make_splits
from rigctl.analysis.study import Findings, Row, Study, percent
from rigctl.analysis.taxel import SHOWN_TRIAL
from rigctl.analysis.train_distances import scaled_trains
from rigctl.analysis.trial_set import TrialRef, open_trials
from rigctl.errors import WrongUse
from rigctl.session.model_file import Classifier

SHOWN_MS = 1000.0
COLOURS = dict(zip(RECEPTORS, ("blue", "red"), strict=True))
NOTE = "Posterior probability of each texture for the trial shown, in per cent."
Floats = NDArray[np.float64]


class _Shown(NamedTuple):
    """A trial that a split tests: its row in the set, and the last representation of each kind."""

    trial: TrialRef
    row: int
    split: Split
    in_time: Representation
    scaled: Representation


def measure(study: Study) -> Findings:
    """Return all stages of one trial, and the probability of each texture.

    Raises WrongUse where no task was run, or the texture is not there.
    """
    if not study.results:
        raise WrongUse("no task was run")
    shown = _choose(study)
    features = study.representations.features(shown.scaled)
    train, trial = shown.split.train, shown.trial
    labels, components = study.design.texture[train], study.results[0].shown_components
    classifier = Classifier(*fit_classifier(features[train], labels, components))
    (logs,) = log_posteriors(classifier, features[[shown.row]])
    names = [study.design.textures[label] for label in np.unique(labels)]
    rows: list[Row] = [
        {"texture": name, "posterior_percent": percent(share)}
        for name, share in zip(names, np.exp(logs).tolist(), strict=True)
    ]
    about = (
        f"Trial {trial.trial_id}: texture {trial.texture}, {trial.speed_mm_s:g} mm/s, "
        f"{trial.force_g:g} {study.representations.trials.press_unit}."
    )
    sentence = (
        f"{about} {classifier.components} components of {shown.scaled.name}, trained on "
        f"{len(labels)} other trials, name it {names[int(logs.argmax())]} with a probability of "
        f"{100 * np.exp(logs.max()):.1f} %."
    )
    panels = [
        *_signals(study, shown),
        *_features(study, shown, features[shown.row]),
        _answer(rows, trial),
    ]
    notes = [about, f"Scaled time is that at {study.representations.scaled.reference_mm_s:g} mm/s."]
    figure = Figure("Figure 1B: one trial, every stage", panels, notes)
    return Findings([sentence], rows, [figure], NOTE)


def _answer(rows: Sequence[Row], trial: TrialRef) -> Bars:
    """Return stage vi: the probability of each texture."""
    named = max(rows, key=lambda row: float(row["posterior_percent"]))["texture"]
    names = [row["texture"] for row in rows]
    names = [f"{name} (true)" if name == trial.texture else name for name in names]
    shares = [row["posterior_percent"] for row in rows]
    series = [Series("probability", "green", range(len(names)), shares)]
    return Bars(f"vi  Texture: {named}", names, series, "posterior probability (%)", (0.0, 100.0))


def _choose(study: Study) -> _Shown:
    """Return a tested trial near the speed of Figure 2C, at another force than the reference."""
    trials, texture = study.representations.trials.trials, shown_texture(study)
    result, reference_g = study.results[0], study.constants.conditions.reference_force_g
    tested = [
        (split, row)
        for split in make_splits(study.design, result.task.family, study.settings.seed, 0)
        for row in np.unique(np.concatenate(list(split.tests.values()))).tolist()
        if trials[row].texture == texture
    ]
    if not tested:
        raise WrongUse(f"{result.task.title.lower()} tests no trial of texture {texture}")

    def rank(case: tuple[Split, int]) -> tuple[bool, float, float, int]:
        trial = trials[case[1]]
        away = abs(trial.speed_mm_s - SHOWN_TRIAL[1])
        return trial.force_g == reference_g, away, -trial.force_g, case[1]

    split, row = min(tested, key=rank)
    in_time, scaled = (
        [one for one in study.shown if one.speed_scaled is is_scaled][-1]
        for is_scaled in (False, True)
    )
    return _Shown(trials[row], row, split, in_time, scaled)


def _signals(study: Study, shown: _Shown) -> list[Traces | Raster]:
    """Return stages i to iv: the first second of readings and spikes."""
    found = study.representations
    with open_trials(found.trials.files) as reader:
        samples = reader.read(shown.trial)
    readings = found.normalisation.apply(samples)[: int(SHOWN_MS)]
    c = np.ones(found.trials.n_taxels)
    if found.force is not None and shown.scaled.force:
        (c,) = c_per_trial([shown.trial], found.force, blind=False)
    title = "ii  Scaled by C" if found.force is not None else "ii  Not scaled: there is no C"
    return [
        _traces("i  Readings (shares of each taxel's range)", readings),
        _traces(title, c * readings),
        _raster(study, shown, shown.in_time, "iii  Spikes", "time (ms)"),
        _raster(study, shown, shown.scaled, "iv  Spikes in scaled time", "scaled time (ms)"),
    ]


def _traces(title: str, readings: Floats) -> Traces:
    return Traces(title, readings.T.tolist(), "time (ms)", "taxel", (0.0, SHOWN_MS))


def _raster(study: Study, shown: _Shown, one: Representation, title: str, label: str) -> Raster:
    table = scaled_trains(study, one, np.array([shown.row], np.intp))
    n = study.representations.trials.n_taxels
    series = []
    for train in range(2 * n):
        receptor = RECEPTORS[train // n]
        times = table.ms[table.ptr[0, train] : table.ptr[0, train + 1]]
        times = times[times <= SHOWN_MS].tolist()
        series.append(Series(receptor, COLOURS[receptor], times, [float(train)] * len(times)))
    names = [f"{receptor}-{taxel + 1}" for receptor in RECEPTORS for taxel in range(n)]
    return Raster(title, names, series, label, (0.0, SHOWN_MS))


def _features(study: Study, shown: _Shown, features: Floats) -> Sequence[Image]:
    """Return stage v: the features of SA and of RA by taxel and window."""
    values = features.reshape(2 * study.representations.trials.n_taxels, -1)
    windows = [str(window + 1) for window in range(values.shape[1])]
    n = len(values) // 2
    taxels = [str(taxel + 1) for taxel in range(n)]
    label = f"window of {study.representations.scaled.window_ms} ms of scaled time"
    return [
        Image(f"v  {name}", taxels, windows, part.tolist(), label, "taxel", middle=None)
        for name, part in (("SA rate (Hz)", values[:n]), ("RA count (spikes)", values[n:]))
    ]
