"""Tests at every number of components, and of whole confusion matrices, as values for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigctl.analysis.paper import published
from rigctl.analysis.paper.statistics import (
    PAIRED,
    PROPORTION_ASTERISKS,
    REPEATED,
    AsteriskRule,
    Difference,
    describe_rule,
    two_proportions,
)
from rigctl.analysis.paper.tasks import Curve, TaskResult

SIGNIFICANT_DIGITS = 6

NOT_IN_PAPER = (
    "The paper tests differences in Figures 4 and S5 only: those of Figure 3 are our addition."
)


def curve_test_dict(
    differences: Sequence[Difference], against: str, *, in_paper: bool
) -> dict[str, Any]:
    """Return the tests of one curve against another: lists with a value for each k from 1.

    ``in_paper``: whether the paper's figure has these asterisks. Undefined values are None.
    """
    first = differences[0]
    return {
        "against": against,
        "test": first.test.name,
        "effect_name": first.test.effect_name,
        "rule": describe_rule(first.rule, first.test),
        "in_paper": in_paper,
        "statistic": [_rounded(one.statistic) for one in differences],
        "p": [_rounded(one.p) for one in differences],
        "effect": [_rounded(one.effect) for one in differences],
        "stars": [one.stars for one in differences],
        "assumptions": sorted({text for one in differences for text in one.assumptions}),
    }


def difference_dict(found: Difference) -> dict[str, Any]:
    """Return one test as values for JSON."""
    return {
        "test": found.test.name,
        "statistic": found.statistic,
        "p": found.p,
        "effect": found.effect,
        "effect_name": found.test.effect_name,
        "rule": describe_rule(found.rule, found.test),
        "stars": found.stars,
        "assumptions": list(found.assumptions),
    }


def task_curve_tests(differences: Mapping[str, Sequence[Difference]]) -> dict[str, Any]:
    """Return the tests of a task of Figure 3 by representation key, each against Original."""
    return {
        key: curve_test_dict(each, "original", in_paper=False) for key, each in differences.items()
    }


def tests_rule(tests: Mapping[str, Mapping[str, Sequence[Difference]]]) -> str:
    """Return what the asterisks mean, empty where there is no test.

    ``tests``: differences by task and representation key.
    """
    each = (one for task in tests.values() for found in task.values() for one in found)
    first = next(each, None)
    return "" if first is None else describe_rule(first.rule, first.test)


def confusion_shares(result: TaskResult) -> dict[str, dict[str, Any]]:
    """Return the share of right answers in each confusion matrix, by representation key.

    ``paper``: the share in the caption of Figures S1 to S4 with ours tested against it, None for
    other tasks. ``from_original``: the test against the matrix of Original, None for Original.
    """
    original = result.curve("original")
    return {
        curve.representation.key: _share_dict(curve, original, result) for curve in result.curves
    }


def _share_dict(curve: Curve, original: Curve | None, result: TaskResult) -> dict[str, Any]:
    correct, n = _counts(curve)
    rule = result.thresholds.proportion_asterisks
    from_original = None
    if original is not None and original is not curve:
        theirs, n_theirs = _counts(original)
        weak = (REPEATED, PAIRED)
        found = two_proportions(correct, theirs, n, n_theirs, rule=rule, weak=weak)
        from_original = difference_dict(found)
    return {
        "correct": correct,
        "of": n,
        "percent": _percent(correct, n),
        "from_original": from_original,
        "paper": _paper_share(curve, result, rule),
    }


def _paper_share(curve: Curve, result: TaskResult, rule: AsteriskRule) -> dict[str, Any] | None:
    """Return the published share of a representation and our share tested against it."""
    key = curve.representation.key
    if result.task.key != published.CONFUSION_TASK or key not in published.CONFUSION_PERCENT:
        return None
    figure, percent = published.CONFUSION_PERCENT[key]
    n_paper = published.CONFUSION_TRIALS
    share = published_share(*_counts(curve), percent, n_paper, rule=rule, weak=(REPEATED,))
    return {"figure": figure, **share}


def published_share(
    correct: int,
    n: int,
    percent: float,
    n_paper: int,
    *,
    rule: AsteriskRule = PROPORTION_ASTERISKS,
    weak: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return a published share in per cent and our ``correct`` of ``n`` tested against it.

    ``weak``: assumptions of the test that do not hold.
    """
    theirs = round(percent / 100 * n_paper)
    found = two_proportions(correct, theirs, n, n_paper, rule=rule, weak=weak)
    return {"percent": percent, "of": n_paper, "test": difference_dict(found)}


def _counts(curve: Curve) -> tuple[int, int]:
    return int(np.trace(curve.confusion)), int(curve.confusion.sum())


def _percent(correct: int, n: int) -> float:
    return float(f"{100 * correct / n:.{SIGNIFICANT_DIGITS}g}")


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")
