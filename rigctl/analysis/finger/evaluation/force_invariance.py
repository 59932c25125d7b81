"""Force invariance without a texture label: the taxel population says how hard it is pressed.

The paper's C needs the true texture. A person's pressure moves all taxels together, so dividing by
the population's mean removes it, and with it what a texture does to all taxels alike. Whether that
helps is measured, not assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.finger.data_sets import FingerDataSet
from rigctl.analysis.finger.published import DEPLOYED
from rigctl.analysis.finger.scans import KINDS, ScanKind, ScanRecording, ScanSet
from rigctl.analysis.finger.tasks import DrawSettings, deployed_accuracy
from rigctl.analysis.paper.statistics import Difference, two_proportions
from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters

Floats = NDArray[np.float64]

NONE_NAME = "no force scaling"
WINDOW_NAME = "rates of each window over their mean of all taxels"
SCAN_NAME = "rates of a scan over their mean of all windows and taxels"
CURRENT_NAME = "current of a scan scaled to equal mean readings"
"""Encoded anew, as the paper scales by C: see :func:`scale_to_population`."""


class ForceComparison(NamedTuple):
    """Accuracy of Figure S5's task with a force scaling, for each kind with 25 components.

    ``accuracy``: over all data sets; ``difference``: from no force scaling, None for that itself.
    """

    name: str
    kind: ScanKind
    accuracy: float
    peak: float
    peak_components: int
    difference: Difference | None

    @property
    def verdict(self) -> str:
        """Whether it helps: p is small enough for an asterisk, however small the effect."""
        if self.difference is None:
            return ""
        p, effect = self.difference.p, self.difference.effect
        if p is None or effect is None or p >= max(most_p for _, most_p, _ in self.difference.rule):
            return "no significant difference"
        return "helps" if effect > 0 else "harms"


def compare_force_scalings(
    data_sets: Sequence[FingerDataSet],
    scaled_currents: Sequence[FingerDataSet] = (),
    settings: DrawSettings | None = None,
) -> list[ForceComparison]:
    """Return the accuracy with each scaling. ``scaled_currents``: the data sets encoded anew."""
    variants: dict[str, Sequence[FingerDataSet]] = {NONE_NAME: data_sets}
    for name, function in RATE_SCALINGS.items():
        variants[name] = [_map_scans(data_set, function) for data_set in data_sets]
    if scaled_currents:
        variants[CURRENT_NAME] = scaled_currents
    return [one for kind in KINDS for one in _compare(variants, kind, settings or DrawSettings())]


def _compare(
    variants: Mapping[str, Sequence[FingerDataSet]], kind: ScanKind, settings: DrawSettings
) -> list[ForceComparison]:
    n = sum(len(data_set.tested) for data_set in variants[NONE_NAME])
    counts = {
        name: _correct_counts(data_sets, kind, settings) for name, data_sets in variants.items()
    }
    plain, found = counts[NONE_NAME], []
    rule = settings.analysis.statistics.proportion_asterisks
    shown = min(settings.finger.components, min(map(len, counts.values()))) - 1
    for name, correct in counts.items():
        best = int(correct.argmax())
        difference = None
        if name != NONE_NAME:
            difference = two_proportions(int(correct[shown]), int(plain[shown]), n, rule=rule)
        found.append(
            ForceComparison(name, kind, correct[shown] / n, correct[best] / n, best + 1, difference)
        )
    return found


def _correct_counts(
    data_sets: Sequence[FingerDataSet], kind: ScanKind, settings: DrawSettings
) -> NDArray[np.int64]:
    """Return the number of right answers in all sets, int64 (k_max,)."""
    rows = [deployed_accuracy(one, kind, settings) * len(one.tested) for one in data_sets]
    k_max = min(settings.finger.k_max(DEPLOYED), *map(len, rows))
    total = np.sum([row[:k_max] for row in rows], axis=0)
    return np.asarray(np.rint(total), np.int64)


def over_window_mean(scans: ScanSet) -> ScanSet:
    """Return scans with each window's rates over their mean of all taxels."""
    return replace(
        scans,
        windows=_over_mean(scans.windows, axis=2),
        time_rates=_over_mean(scans.time_rates, axis=2),
    )


def over_scan_mean(scans: ScanSet) -> ScanSet:
    """Return scans with all rates over their mean of the whole scan."""
    return replace(
        scans,
        windows=_over_mean(scans.windows, axis=(1, 2)),
        time_rates=_over_scan_mean(scans.time_rates, scans.n_time_windows),
    )


RATE_SCALINGS: Mapping[str, Callable[[ScanSet], ScanSet]] = {
    WINDOW_NAME: over_window_mean,
    SCAN_NAME: over_scan_mean,
}


def scale_to_population(
    recordings: Sequence[ScanRecording],
    normalisation: Normalisation,
    reference: float,
    parameters: EncoderParameters = DEFAULT,
) -> list[ScanRecording]:
    """Return recordings encoded anew with the SA current of each scan times reference over mean.

    The mean is that of a scan's normalised readings over all taxels; ``reference`` is that of the
    training scans. It is the paper's C with the population in the place of the true texture.
    """
    population = np.array([population_reading(one, normalisation) for one in recordings])
    scale = reference / np.maximum(population, np.finfo(np.float64).tiny)
    lanes = np.repeat(scale[:, None], normalisation.n_taxels, axis=1)
    trains = encode_trials(
        [one.readings for one in recordings], normalisation, parameters, sa_scale=lanes
    )
    encoded = []
    for one, spikes in zip(recordings, trains, strict=True):
        raster = np.zeros(one.readings.shape, np.uint8)
        for taxel in range(normalisation.n_taxels):
            np.add.at(raster[:, taxel], spikes.train(taxel), 1)
        encoded.append(one._replace(spikes=raster))
    return encoded


def population_reading(recording: ScanRecording, normalisation: Normalisation) -> float:
    """Return the mean normalised reading of all taxels, 0 to 1."""
    return float(normalisation.apply(recording.readings).mean())


def _map_scans(data_set: FingerDataSet, scale: Callable[[ScanSet], ScanSet]) -> FingerDataSet:
    return replace(
        data_set,
        training=scale(data_set.training),
        calibration=scale(data_set.calibration),
        tested=scale(data_set.tested),
    )


def _over_mean(rates: Floats, axis: int | tuple[int, int]) -> Floats:
    """Return rates over their mean along axes, 0 where that is 0."""
    mean = rates.mean(axis=axis, keepdims=True)
    return np.asarray(np.divide(rates, mean, out=np.zeros_like(rates), where=mean > 0))


def _over_scan_mean(rates: Floats, n_windows: NDArray[np.int64]) -> Floats:
    """Return rates float64 (n, w, taxels) over the mean of each scan's own windows."""
    total = rates.sum(axis=(1, 2), keepdims=True)
    mean = total / (np.maximum(n_windows, 1)[:, None, None] * rates.shape[2])
    return np.asarray(np.divide(rates, mean, out=np.zeros_like(rates), where=mean > 0))
