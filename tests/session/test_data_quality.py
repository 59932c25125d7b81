"""Trials judged on their data, beside equal trials: broken, unusual, or good."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from rigctl.protocol.plan import Quality
from rigctl.session.data_quality import (
    LEAST_RESIDUALS,
    CellStatistics,
    DataVerdict,
    TrialHistory,
    TrialStatistics,
    cell_statistics,
    student_quantile,
)
from rigctl.session.trial_sums import TrialSums

CONDITION = ("A", 80.0, 500.0, 0.0)
N = 18


def trial(rng: np.random.Generator, scatter: float = 0.02) -> TrialStatistics:
    """Return the statistics of a trial whose mean readings scatter by a share."""
    mean = 200.0 * np.exp(rng.normal(0.0, scatter, N))
    sd, noise = np.full(N, 20.0), np.full(N, 0.8)
    low, high = np.full(N, 150), np.full(N, 250)
    zero = np.zeros(N)
    return TrialStatistics(mean, sd, noise, low, high, zero, zero, CellStatistics(0.3, 1.0), 5000.0)


def judged(trials: Sequence[TrialStatistics], limits: Quality | None = None) -> list[DataVerdict]:
    history = TrialHistory(limits or Quality())
    return [history.judge(CONDITION, one) for one in trials]


def last(changed: TrialStatistics, n_before: int = 4) -> DataVerdict:
    """Return the verdict on a trial after some good ones."""
    rng = np.random.default_rng(1)
    *before, verdict = judged([*(trial(rng) for _ in range(n_before)), changed])
    assert before == [DataVerdict()] * n_before
    return verdict


def with_taxel(values: np.ndarray, taxel: int, value: float) -> np.ndarray:
    changed = values.copy()
    changed[taxel] = value
    return changed


GOOD = trial(np.random.default_rng(7))
MOVED = {"low": with_taxel(GOOD.low, 6, 0), "high": with_taxel(GOOD.high, 6, 4)}
DEAD = replace(GOOD, mean=with_taxel(GOOD.mean, 6, 2.0), sd=with_taxel(GOOD.sd, 6, 0.8), **MOVED)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        (DEAD, "taxel 7 stays at 2 counts"),
        (
            replace(GOOD, noise=with_taxel(GOOD.noise, 2, 9.0)),
            "taxel 3 scatters by 9.0 counts from sample to sample",
        ),
        (
            replace(GOOD, cell=CellStatistics(6.0, 20.0)),
            "the load cell scatters by 6.0 g from reading to reading",
        ),
        (
            replace(GOOD, cell=CellStatistics(0.3, 140.0)),
            "one reading of the load cell is 140 g off its neighbours",
        ),
    ],
)
def test_what_is_broken_is_repeated(changed: TrialStatistics, reason: str) -> None:
    verdict = last(changed)
    assert verdict.repeat == (reason,) and verdict.quarantine == ()


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        (
            replace(GOOD, top_share=with_taxel(GOOD.top_share, 0, 0.6)),
            "taxel 1 is at the end of its range in 60% of the samples",
        ),
        (
            replace(GOOD, baseline=with_taxel(GOOD.baseline, 17, 80.0)),
            "taxel 18 reads +80 counts, lifted, since the start",
        ),
    ],
)
def test_what_is_unusual_is_put_into_quarantine(changed: TrialStatistics, reason: str) -> None:
    verdict = last(changed)
    assert verdict.quarantine == (reason,) and verdict.repeat == ()


def test_drift_is_measured_from_the_first_baseline_that_is_known() -> None:
    unknown = replace(GOOD, baseline=np.full(N, np.nan))
    drifted = replace(GOOD, baseline=with_taxel(GOOD.baseline, 17, 80.0))
    *good, verdict = judged([unknown, GOOD, drifted])
    assert good == [DataVerdict()] * 2
    assert verdict.quarantine == ("taxel 18 reads +80 counts, lifted, since the start",)


def test_an_outlier_is_named_with_its_distance() -> None:
    verdict = last(replace(GOOD, mean=with_taxel(GOOD.mean, 4, 260.0)), LEAST_RESIDUALS + 10)
    (reason,) = verdict.quarantine
    assert reason.startswith("the mean of taxel 5 is +")
    assert reason.endswith("% off equal trials, which scatter by 2%")


def test_first_trials_have_nothing_to_be_compared_with() -> None:
    assert last(DEAD, 2) == DataVerdict(), "a taxel may be dead in every trial: see the page"


@pytest.mark.parametrize(
    ("plate", "force_g", "kind"),
    [("A", 500.0, "repeat"), ("A", 1000.0, "repeat"), ("A", 250.0, ""), ("B", 500.0, "quarantine")],
)
def test_a_new_condition_is_compared_with_presses_no_harder(
    plate: str, force_g: float, kind: str
) -> None:
    rng, history = np.random.default_rng(1), TrialHistory(Quality())
    for _ in range(4):
        history.judge(CONDITION, trial(rng))
    verdict = history.judge((plate, 40.0, force_g, 0.0), DEAD)
    assert (bool(verdict.repeat), bool(verdict.quarantine)) == (
        kind == "repeat",
        kind == "quarantine",
    )


def test_a_taxel_that_never_moved_is_no_reason() -> None:
    assert judged([DEAD] * 6) == [DataVerdict()] * 6


def test_good_trials_are_unusual_as_often_as_is_stated() -> None:
    rng = np.random.default_rng(3)
    trials = [trial(rng, 0.05) for _ in range(4000)]
    limits = Quality(false_alarms_percent=1.0)
    unusual = sum(bool(one.quarantine) for one in judged(trials, limits))
    assert 4 <= unusual <= 60, "1 % are stated, of scatter with wider tails than a normal one"
    assert not any(one.quarantine for one in judged(trials, Quality(false_alarms_percent=0.0)))


@pytest.mark.parametrize("tail", [1e-2, 1e-3, 1e-5, 1e-7])
def test_the_quantile_is_students(tail: float) -> None:
    assert student_quantile(tail) == pytest.approx(stdtrit(30, 1 - tail), rel=1e-3)


def test_sums_over_blocks_are_those_of_the_whole() -> None:
    samples = np.random.default_rng(5).integers(0, 1024, (500, N)).astype(np.uint16)
    whole, parts = TrialSums(N), TrialSums(N)
    whole.add(samples)
    for block in np.array_split(samples, 7):
        parts.add(block)
    for sums in (whole, parts):
        found = sums.statistics()
        np.testing.assert_allclose(found.mean, samples.mean(axis=0))
        np.testing.assert_allclose(found.sd, samples.std(axis=0))
        steps = np.diff(samples.astype(float), axis=0)
        np.testing.assert_allclose(found.noise, np.sqrt(np.square(steps).mean(axis=0) / 2))
        assert found.low.tolist() == samples.min(axis=0).tolist()
        assert found.high.tolist() == samples.max(axis=0).tolist()
        np.testing.assert_allclose(found.top_share, (samples >= 1023).mean(axis=0))


def test_the_load_cells_noise_is_that_of_its_readings() -> None:
    forces_g = 500.0 + np.random.default_rng(2).normal(0.0, 0.4, 4000)
    forces_g[100] += 30.0
    found = cell_statistics(forces_g)
    assert found.noise_g == pytest.approx(0.4, rel=0.1)
    assert found.spike_g == pytest.approx(30.0, abs=2.0)
    assert np.isnan(cell_statistics(forces_g[:2])).all()
