"""Tests of difference against hand-worked and published values, and the asterisk rules."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest, chi2_contingency

from rigctl.analysis.statistics import (
    ASTERISKS,
    PROPORTION_ASTERISKS,
    TWO_PROPORTIONS,
    WELCH,
    Difference,
    asterisks,
    describe_rule,
    standard_deviation,
    standard_error,
    two_proportions,
    welch_each,
    wilson_interval,
)
from rigctl.errors import WrongUse


def welch(first: list[float], second: list[float]) -> Difference:
    (found,) = welch_each(np.array(first)[:, None], np.array(second)[:, None])
    return found


def test_welch_and_d_are_those_worked_by_hand() -> None:
    """Means 0.5 and 0.3, variances 0.01 and 0.04, n = 3 each: t = 0.2 / sqrt(0.05 / 3)."""
    found = welch([0.4, 0.5, 0.6], [0.1, 0.3, 0.5])
    assert found.statistic == pytest.approx(0.2 / np.sqrt(0.05 / 3))
    assert found.effect == pytest.approx(0.2 / np.sqrt(0.025))
    assert found.p is not None and 0.19 < found.p < 0.25  # 2.94 degrees of freedom
    assert found.stars == "" and len(found.assumptions) == 1


def test_wilson_interval_is_the_published_one() -> None:
    """Newcombe 1998, table I, method 3: 81 of 263 and 0 of 20."""
    np.testing.assert_allclose(wilson_interval(81, 263), (0.2553, 0.3662), atol=5e-5)
    np.testing.assert_allclose(wilson_interval(0, 20), (0.0, 0.1611), atol=5e-5)


@pytest.mark.parametrize(
    ("first", "n", "second", "others"), [(1, 3, 2, 2), (185, 300, 157, 300), (4999, 5000, 9, 11)]
)
def test_scipy_computes_the_same_to_twelve_digits(
    first: int, n: int, second: int, others: int
) -> None:
    interval = binomtest(first, n).proportion_ci(method="wilson")
    np.testing.assert_allclose(wilson_interval(first, n), interval, rtol=1e-12)
    table = [[first, n - first], [second, others - second]]
    square, p, *_ = chi2_contingency(table, correction=False)
    found = two_proportions(first, second, n, others)
    assert (found.statistic or 0) ** 2 == pytest.approx(square, rel=1e-12)
    assert found.p == pytest.approx(p, rel=1e-12)


@pytest.mark.parametrize(
    ("p", "effect", "stars"),
    [
        (0.04, 0.6, "*"),
        (0.05, 0.6, ""),
        (0.04, 0.5, ""),
        (0.009, -1.2, "**"),
        (0.009, 0.9, "*"),
        (0.02, 2.0, "*"),
    ],
)
def test_asterisks_need_both_bounds(p: float, effect: float, stars: str) -> None:
    assert asterisks(p, effect) == stars


def test_an_undefined_test_has_a_sentence_and_no_number() -> None:
    found = welch([0.1 + 0.2] * 20, [0.2] * 20)
    assert (found.statistic, found.p, found.effect, found.stars) == (None, None, None, "")
    assert any("Neither side varies" in sentence for sentence in found.assumptions)
    lonely = welch([0.5], [0.6])
    assert lonely.p is None and any("One value" in s for s in lonely.assumptions)
    with pytest.raises(WrongUse, match="not a number"):
        welch([0.5, np.nan], [0.6, 0.7])


def test_weak_assumptions_are_reported() -> None:
    high = welch([0.991, 0.993, 0.995], [0.90, 0.91, 0.92])
    assert any("close to 100 %" in s for s in high.assumptions)
    assert any("not independent" in s for s in high.assumptions)


def test_two_proportions_are_those_worked_by_hand() -> None:
    """185 and 157 of 300: p̂ = 0.57, z = 28/300 / sqrt(0.57 · 0.43 · 2 / 300)."""
    found = two_proportions(185, 157, 300)
    assert found.statistic == pytest.approx((28 / 300) / np.sqrt(0.57 * 0.43 * 2 / 300))
    h = 2 * np.arcsin(np.sqrt(185 / 300)) - 2 * np.arcsin(np.sqrt(157 / 300))
    assert found.effect == pytest.approx(h) and 0.01 < (found.p or 0) < 0.05
    assert found.stars == "", "h is below 0.2"
    assert any("same trials" in sentence for sentence in found.assumptions)


@pytest.mark.parametrize(("first", "stars"), [(160, ""), (180, "*"), (240, "**"), (60, "**")])
def test_figure_s5_has_its_own_rule(first: int, stars: str) -> None:
    assert two_proportions(first, 150, 300).stars == stars


def test_proportions_without_a_difference_to_test_have_no_p() -> None:
    assert two_proportions(0, 0, 300).p is None and two_proportions(0, 0, 300).stars == ""
    assert two_proportions(300, 300, 300).p is None
    with pytest.raises(WrongUse, match="no counts"):
        two_proportions(301, 0, 300)


def test_shares_of_different_numbers_of_trials_are_compared() -> None:
    """20 of 40 and 90 of 120: pooled 0.6875, z = −0.25 / sqrt(0.6875 · 0.3125 / 30)."""
    found = two_proportions(20, 90, 40, 120)
    assert found.statistic == pytest.approx(-0.25 / np.sqrt(0.6875 * 0.3125 / 30))
    with pytest.raises(WrongUse, match="40 and 120 trials"):
        two_proportions(41, 90, 40, 120)


def test_deviation_and_error_are_over_rows_and_need_two() -> None:
    values = np.array([[0.1, 0.5], [0.3, 0.5], [0.5, 0.5]])
    deviation, error = standard_deviation(values), standard_error(values)
    np.testing.assert_allclose(deviation, (0.2, 0.0), atol=1e-15)
    np.testing.assert_allclose(error, (0.2 / np.sqrt(3), 0.0), atol=1e-15)
    assert standard_deviation(values[:1]) is None and standard_error(values[:1]) is None


def test_rules_are_described_with_the_letter_of_their_effect() -> None:
    assert describe_rule(ASTERISKS, WELCH) == "* p < 0.05 and d > 0.5; ** p < 0.01 and d > 1"
    assert describe_rule(PROPORTION_ASTERISKS, TWO_PROPORTIONS).endswith("** p < 0.01 and h > 0.5")
