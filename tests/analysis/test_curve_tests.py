"""Asterisks at every number of components, and the confusion matrices beside Figures S1 to S4."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis import published
from rigctl.analysis.comparisons import Agreement, compare_task, curve_differences
from rigctl.analysis.representations import REPRESENTATIONS
from rigctl.analysis.settings import AsteriskThresholds
from rigctl.analysis.statistics import (
    confusion_shares,
    task_curve_tests,
    two_proportions,
    welch_each,
)
from rigctl.analysis.tasks import Curve, TaskResult

CLASSES = tuple("ABCDEFGHIJKLMNOP")


def made_result(key: str, **shares: tuple[list[float], int]) -> TaskResult:
    """Four draws about each share; right answers of 1,000 trials a texture, the rest one off."""
    by_key = {one.key: one for one in REPRESENTATIONS}
    spread = np.array([-0.015, -0.005, 0.005, 0.015])
    curves = []
    for name, (means, right) in shares.items():
        confusion = np.eye(16, dtype=np.int64) * right
        confusion += np.roll(np.eye(16, dtype=np.int64), 1, axis=1) * (1000 - right)
        curves.append(Curve(by_key[name], np.add.outer(spread, means), confusion, 800, 0, 0))
    task = next(task for task in published.TASKS if task.key == key)
    return TaskResult(task, CLASSES, 3, 7200, 1 / 16, tuple(curves))


RESULT = made_result(
    "untrained-both",
    original=([0.3, 0.4, 0.5], 368),
    speed=([0.3, 0.41, 0.7], 700),
    force=([0.2, 0.4, 0.6], 368),
)


def test_each_number_of_components_has_welchs_test_and_its_asterisks() -> None:
    found = task_curve_tests(curve_differences(RESULT))
    assert list(found) == ["speed", "force"] and found["speed"]["against"] == "original"
    assert found["speed"]["stars"] == ["", "", "**"]
    assert found["force"]["stars"] == ["**", "", "**"] and found["force"]["effect"][0] < 0
    original, speed = (RESULT.curves[number].accuracy for number in (0, 1))
    third = welch_each(speed[:, 2:3], original[:, 2:3])[0]
    assert found["speed"]["p"][2] == pytest.approx(third.p, rel=1e-5)
    assert found["speed"]["effect"][2] == pytest.approx(third.effect, rel=1e-5)
    assert found["speed"]["rule"] == "* p < 0.05 and d > 0.5; ** p < 0.01 and d > 1"
    assert found["speed"]["in_paper"] is False, "Figure 3 of the paper has no asterisks"


def test_an_analysis_file_sets_the_bounds_of_asterisks_and_of_what_holds() -> None:
    strict = AsteriskThresholds(one_star_d=30.0, two_star_d=50.0, two_star_h=0.9)
    found = task_curve_tests(curve_differences(replace(RESULT, thresholds=strict)))["speed"]
    assert found["stars"] == ["", "", ""], "d is 15 with three components"
    assert found["rule"] == "* p < 0.05 and d > 30; ** p < 0.01 and d > 50"
    share = confusion_shares(replace(RESULT, thresholds=strict))["speed"]["from_original"]
    assert share["stars"] == "*" and share["rule"].endswith("** p < 0.01 and h > 0.9")
    tied = []
    for least_d in (0.5, 9.0):
        bounds = AsteriskThresholds(one_star_d=least_d, two_star_d=9.0)
        compared = compare_task(replace(RESULT, thresholds=bounds), simulated=False)
        assert compared is not None
        tied.append(compared.keys(Agreement.TIED))
    assert tied == [[], [("force", "original")]]


def test_a_reversal_within_two_deviations_is_one_if_the_test_says_so() -> None:
    spread = np.linspace(-0.015, 0.015, 20)[:, None]
    by_key = {one.key: one for one in REPRESENTATIONS}
    curves = tuple(
        Curve(by_key[key], spread + mean, np.eye(16, dtype=np.int64), 800, 0, 0)
        for key, mean in (("speed", 0.60), ("force", 0.585))
    )
    task = next(task for task in published.TASKS if task.key == "untrained-force")
    result = TaskResult(task, CLASSES, 1, 7200, 1 / 16, curves)
    found = compare_task(result, simulated=False)
    assert found is not None and found.keys(Agreement.REVERSED) == [("force", "speed")]
    (pair,) = found.pairs
    assert abs(pair.gap) < 2 * np.hypot(spread.std(ddof=1), spread.std(ddof=1))
    assert pair.difference.p is not None and pair.difference.p < 1e-4


def test_an_undefined_test_is_null_and_the_others_remain() -> None:
    accuracy = np.array([[0.5, 0.4], [0.5, 0.6]])
    curves = tuple(
        Curve(one, accuracy + shift, np.eye(16, dtype=np.int64), 8, 0, 0)
        for one, shift in zip(REPRESENTATIONS, (0.0, 0.1), strict=False)
    )
    result = TaskResult(published.TASKS[0], CLASSES, 2, 10, 1 / 16, curves)
    (found,) = task_curve_tests(curve_differences(result)).values()
    assert found["p"][0] is None and found["p"][1] is not None
    assert any("Neither side varies" in text for text in found["assumptions"])
    json.dumps(found, allow_nan=False)


def test_confusions_stand_beside_the_captions_of_s1_to_s4() -> None:
    shares = confusion_shares(RESULT)
    original, speed = shares["original"], shares["speed"]
    assert (original["percent"], original["of"], original["from_original"]) == (36.8, 16000, None)
    assert original["paper"]["percent"] == 36.78 and original["paper"]["figure"] == "Fig. S1"
    assert abs(original["paper"]["test"]["effect"]) < 0.001
    expected = two_proportions(700 * 16, 368 * 16, 16000)
    assert speed["from_original"]["statistic"] == pytest.approx(expected.statistic)
    assert speed["from_original"]["effect_name"] == "Cohen's h"
    assert speed["from_original"]["stars"] == "**"
    assert any("every draw that tests it" in s for s in speed["from_original"]["assumptions"])
    other = made_result("textures", original=([0.5, 0.5, 0.5], 500))
    assert confusion_shares(other)["original"]["paper"] is None


def test_the_captions_are_near_table_1_and_not_equal_to_it() -> None:
    table = published.TABLE_1[published.CONFUSION_TASK]
    for key, (_, percent) in published.CONFUSION_PERCENT.items():
        assert 0 < table[key][0] - percent < table[key][1]
