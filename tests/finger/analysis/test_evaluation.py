"""Evidence, kept promises, unknown plates and profiles, on made-up sessions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rigctl.finger.analysis.classifier import FingerClassifier
from rigctl.finger.analysis.evaluation import (
    LeftOutTask,
    evidence_curve,
    leave_texture_out,
    measure_coverage,
    measure_novelty,
    measure_sequential,
    profile_differences,
    train_classifier,
)
from rigctl.finger.analysis.scans import KINDS, FingerDataSet, ScanSet
from rigctl.finger.values import ScanKind
from tests.finger.analysis.made_scans import made_data_set


@cache
def sets() -> list[FingerDataSet]:
    return [made_data_set(seed, repeats=4, contrast=0.012) for seed in (1, 2)]


def run_scans() -> list[ScanSet]:
    return [one.tested for one in sets()]


@cache
def scaled() -> list[FingerClassifier]:
    return [train_classifier(one, ScanKind.SPEED_SCALED) for one in sets()]


@cache
def empty() -> FingerDataSet:
    return made_data_set(3, repeats=4, contrast=0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_evidence_ends_at_the_accuracy_of_whole_scans(kind: ScanKind) -> None:
    classifiers = [train_classifier(one, kind) for one in sets()]
    curve = evidence_curve(classifiers, run_scans())
    whole = np.mean(
        [
            (c.predict(s.features(kind)) == s.labels(c.model.textures)).mean()
            for c, s in zip(classifiers, run_scans(), strict=True)
        ]
    )
    assert curve.at_mm.tolist() == [10.0 * n for n in range(1, 21)]
    assert curve.by_s[-1] == pytest.approx(whole) and curve.by_mm[-1] == pytest.approx(whole)
    assert curve.at_s[0] == 0.1 and np.allclose(np.diff(curve.at_s), 0.1)


def test_more_evidence_gives_more_right_answers() -> None:
    curve = evidence_curve(scaled(), run_scans())
    assert curve.by_mm[0] + 0.2 < curve.by_mm[9] < curve.by_mm[-1] + 0.05
    assert curve.by_s[0] < curve.by_s[10] < curve.by_s[-1] + 0.05


def test_before_the_first_window_an_answer_is_a_guess() -> None:
    """At 70 mm/s the first 10 mm take 143 ms."""
    slow = [scans.of_profiles(["slow"]) for scans in run_scans()]
    assert evidence_curve(scaled(), slow).by_s[0] == pytest.approx(0.2)


def test_sets_hold_the_texture_as_promised_and_say_how_large_they_are() -> None:
    found = measure_coverage(scaled(), run_scans())
    assert found.n == 200 and found.coverage[-1] > 0.9
    assert found.mean_size[-1] < found.mean_size[0] and found.failures[-1] < 0.5
    assert "mean size" in found.sentence and "of 200 held-out trials" in found.sentence


def test_sets_of_all_textures_are_reported_as_a_failure() -> None:
    classifier = train_classifier(empty(), ScanKind.SPEED_SCALED)
    found = measure_coverage([classifier], [empty().tested])
    assert found.mean_size[-1] > 4.0 and found.failures[-1] > 0.2
    assert "FAILURE in" in found.sentence and "holds all textures" in found.sentence


def test_a_plate_that_was_never_trained_is_found() -> None:
    strong = made_data_set(4, repeats=4, contrast=0.05)
    tasks = [LeftOutTask(strong, ScanKind.SPEED_SCALED, name) for name in strong.textures]
    found = measure_novelty([leave_texture_out(task) for task in tasks])
    assert found.detected[-1] > 0.8 and found.area > 0.95
    assert found.false_alarms[-1] < 0.15 and set(found.by_texture) == set(strong.textures)
    blank = leave_texture_out(LeftOutTask(empty(), ScanKind.SPEED_SCALED, "A"))
    assert blank.detected[-1] < 0.3, "without a pattern there is nothing to find"


def test_early_answers_cost_less_and_keep_their_rate() -> None:
    careful, careless = (measure_sequential(scaled(), run_scans(), asked) for asked in (0.05, 0.2))
    assert careless.mean_mm is not None and careless.mean_s is not None
    assert careless.error_rate is not None and careless.error_rate < 0.3
    assert careful.answered < careless.answered or (careful.mean_mm or 0) > careless.mean_mm
    assert 10 <= careless.mean_mm <= 200 and careless.mean_s < 2.5
    hopeless = measure_sequential(
        [train_classifier(empty(), ScanKind.SPEED_SCALED)], [empty().tested], 0.01
    )
    assert hopeless.answered == 0 and hopeless.error_rate is None and hopeless.sets_without == 1


def test_profiles_differ_by_what_scaling_leaves() -> None:
    """Spikes here are so many a second, whatever the speed: rates are equal, counts are not."""
    scans = sets()[0].training
    found = profile_differences(scans, ScanKind.SPEED_SCALED)
    assert found.spread < 0.05 and found.texture_share > 0.1
    assert found.profile_share < 0.2
    faster = scans.profile == "fast"
    moved = replace(scans, windows=np.where(faster[:, None, None], 1.5, 1.0) * scans.windows)
    assert profile_differences(moved, ScanKind.SPEED_SCALED).spread > 0.4
    silent = replace(scans, windows=np.zeros_like(scans.windows))
    assert profile_differences(silent, ScanKind.SPEED_SCALED).texture_share == 0.0
