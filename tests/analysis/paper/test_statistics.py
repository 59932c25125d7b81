"""Tests of difference against hand-worked and published values, and the asterisk rules."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.paper.statistics import (
    FIGURE_4,
    FIGURE_S5,
    AsteriskRule,
    cohens_d,
    cohens_h,
    two_proportions,
    welch,
    wilson_interval,
)
from rigctl.errors import WrongUse


def test_welch_and_d_are_those_worked_by_hand() -> None:
    """Means 0.5 and 0.3, variances 0.01 and 0.04, n = 3 each: t = 0.2 / sqrt(0.05 / 3)."""
    first, second = np.array([0.4, 0.5, 0.6]), np.array([0.1, 0.3, 0.5])
    found = welch(first, second, redrawn=False)
    assert found.statistic == pytest.approx(0.2 / np.sqrt(0.05 / 3))
    assert found.effect == pytest.approx(0.2 / np.sqrt(0.025))
    assert found.p is not None and 0.19 < found.p < 0.25  # 2.94 degrees of freedom
    assert found.stars == "" and found.assumptions == ()


def test_two_proportions_are_those_worked_by_hand() -> None:
    """60 of 100 against 40 of 100: z = 0.2 / sqrt(0.5 · 0.5 · 0.02); h = 0.4027 (Cohen 1988)."""
    found = two_proportions((60, 40), (100, 100))
    assert found.statistic == pytest.approx(0.2 / np.sqrt(0.005))
    assert found.effect == pytest.approx(0.4027, abs=1e-4)
    assert found.stars == "*"
    assert cohens_h(0.4, 0.6) == pytest.approx(-0.4027, abs=1e-4)


def test_wilson_interval_is_the_published_one() -> None:
    """Newcombe 1998, table I, method 3: 81 of 263 and 0 of 20."""
    np.testing.assert_allclose(wilson_interval(81, 263), (0.2553, 0.3662), atol=5e-5)
    np.testing.assert_allclose(wilson_interval(0, 20), (0.0, 0.1611), atol=5e-5)


@pytest.mark.parametrize(
    ("rule", "p", "effect", "stars"),
    [
        (FIGURE_4, 0.04, 0.6, "*"),
        (FIGURE_4, 0.05, 0.6, ""),
        (FIGURE_4, 0.04, 0.5, ""),
        (FIGURE_4, 0.009, -1.2, "**"),
        (FIGURE_4, 0.009, 0.9, "*"),
        (FIGURE_4, 0.02, 2.0, "*"),
        (FIGURE_S5, 0.04, 0.3, "*"),
        (FIGURE_S5, 0.004, 0.6, "**"),
        (FIGURE_S5, 0.004, 0.1, ""),
    ],
)
def test_asterisks_need_both_bounds(
    rule: AsteriskRule, p: float, effect: float, stars: str
) -> None:
    assert rule.stars(p, effect) == stars


def test_an_undefined_test_has_a_sentence_and_no_number() -> None:
    alike = np.full(20, 0.1 + 0.2)
    found = welch(alike, alike - 0.1)
    assert (found.statistic, found.p, found.effect, found.stars) == (None, None, None, "")
    assert any("Neither side varies" in sentence for sentence in found.assumptions)
    assert cohens_d(alike, alike) is None
    lonely = welch(np.array([0.5]), np.array([0.6]))
    assert lonely.p is None and any("One value" in s for s in lonely.assumptions)
    certain = two_proportions((20, 30), (20, 30))
    assert certain.p is None and certain.effect == 0.0
    with pytest.raises(WrongUse, match="not a number"):
        welch(np.array([0.5, np.nan]), np.array([0.6, 0.7]))
    with pytest.raises(WrongUse, match="cannot be compared"):
        two_proportions((3, 1), (2, 5))


def test_weak_assumptions_are_reported() -> None:
    high = welch(np.array([0.991, 0.993, 0.995]), np.array([0.90, 0.91, 0.92]))
    assert any("close to 100 %" in s for s in high.assumptions)
    assert any("not independent" in s for s in high.assumptions)
    assert any("rough guide" in s for s in two_proportions((1, 3), (10, 10)).assumptions)
