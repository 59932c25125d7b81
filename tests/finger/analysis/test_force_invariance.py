"""Force scalings without a label undo what they should, and their verdict follows the numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigctl.encoder.normalisation import Normalisation
from rigctl.finger.analysis.evaluation import (
    CURRENT_NAME,
    NONE_NAME,
    SCAN_NAME,
    WINDOW_NAME,
    compare_force_scalings,
    over_scan_mean,
    over_window_mean,
)
from rigctl.finger.analysis.scans import (
    FingerDataSet,
    ScanSet,
    encode_readings,
    population_reading,
    scale_to_population,
)
from rigctl.finger.values import Stage
from tests.finger.analysis.made_scans import RANGES, made_data_set, made_recordings

DATA_SET = made_data_set(1, contrast=0.015)


def _pressed(scans: ScanSet, seed: int, spread: float) -> ScanSet:
    """Return scans whose rates are multiplied by a factor for each scan."""
    factor = np.exp(spread * np.random.default_rng(seed).standard_normal((len(scans), 1, 1)))
    return replace(scans, windows=scans.windows * factor, time_rates=scans.time_rates * factor)


def test_a_common_factor_disappears() -> None:
    scans = DATA_SET.tested
    pressed = _pressed(scans, 1, 0.5)
    for scale in (over_window_mean, over_scan_mean):
        plain, found = scale(scans), scale(pressed)
        np.testing.assert_allclose(found.windows, plain.windows, rtol=1e-12)
        np.testing.assert_allclose(found.time_rates, plain.time_rates, rtol=1e-12)
    means = over_window_mean(scans).windows.mean(axis=2)
    assert np.all(np.isclose(means, 1.0) | (means == 0.0))


def test_it_helps_where_force_is_all_that_varies() -> None:
    pressed = FingerDataSet(
        "pressed",
        *(
            _pressed(part, seed, 1.5)
            for seed, part in enumerate((DATA_SET.training, DATA_SET.calibration, DATA_SET.tested))
        ),
    )
    found = {
        one.scaling: one for one in compare_force_scalings([pressed]) if one.kind == "Speed Scaled"
    }
    assert set(found) == {NONE_NAME, WINDOW_NAME, SCAN_NAME}
    assert found[SCAN_NAME].verdict == "helps" and found[NONE_NAME].verdict == ""
    assert found[SCAN_NAME].accuracy > found[NONE_NAME].accuracy + 0.2


def test_it_harms_where_the_mean_is_what_tells_textures_apart() -> None:
    """Negative control: with equal patterns, the level alone is the texture."""

    def levelled(scans: ScanSet) -> ScanSet:
        level = (1.0 + scans.labels(scans.textures))[:, None, None]
        random = np.random.default_rng(len(scans))
        noise = 1.0 + 0.02 * random.standard_normal(scans.windows.shape)
        return replace(scans, windows=100.0 * level * noise)

    parts = map(levelled, (DATA_SET.training, DATA_SET.calibration, DATA_SET.tested))
    data_set = FingerDataSet("levels", *parts)
    (found,) = (
        one
        for one in compare_force_scalings([data_set])
        if (one.kind, one.scaling) == ("Speed Scaled", WINDOW_NAME)
    )
    assert found.verdict == "harms"


def test_scaled_currents_give_a_soft_press_the_spikes_of_a_firm_one() -> None:
    firm = made_recordings({Stage.TRAIN: 1}, 2)[:6]
    ranges = Normalisation(np.zeros(9, np.uint16), np.full(9, 1000, np.uint16), "test")
    firm = [one._replace(spikes=encode_readings(one.readings, ranges)) for one in firm]
    soft = [one._replace(readings=(one.readings * 0.6).astype(np.uint16)) for one in firm]
    soft = [one._replace(spikes=encode_readings(one.readings, ranges)) for one in soft]
    for weak, strong in zip(soft, firm, strict=True):
        reference = population_reading(strong, ranges)
        (scaled,) = scale_to_population([weak], ranges, reference)
        lost, left = (
            abs(int(one.spikes.sum()) - int(strong.spikes.sum())) for one in (weak, scaled)
        )
        assert lost > 100 and left < 0.03 * strong.spikes.sum()
        (same,) = scale_to_population([strong], ranges, reference)
        assert np.array_equal(same.spikes, strong.spikes)


def test_currents_encoded_anew_are_compared_too() -> None:
    names = {one.scaling for one in compare_force_scalings([DATA_SET], [DATA_SET])}
    assert CURRENT_NAME in names and RANGES.n_taxels == 9
    (same,) = (
        one
        for one in compare_force_scalings([DATA_SET], [DATA_SET])
        if (one.kind, one.scaling) == ("Original", CURRENT_NAME)
    )
    assert same.verdict == "no significant difference"
