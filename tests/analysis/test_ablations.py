"""Measurements on a comparison that does not hold, and the sentences made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis import further_tasks
from rigctl.analysis.comparisons import (
    Ablations,
    Agreement,
    FeatureHalf,
    TaskComparison,
    _split_variance,
    _VarianceJob,
    compare_task,
    explain,
)
from rigctl.analysis.report.several_reports import summary_sentences
from rigctl.analysis.representations import REPRESENTATIONS
from rigctl.analysis.tasks import Curve, TaskResult
from rigctl.analysis.trial_set import Design

TASKS = {task.key: task for task in further_tasks.TASKS}
BY_KEY = {r.key: r for r in REPRESENTATIONS}


def test_variance_is_attributed_to_its_factor(tmp_path: Path) -> None:
    """SA: speed alone, in the first of five windows. RA: force, and as much inside conditions."""
    texture, speed, force, turn = (
        axis.ravel() for axis in np.meshgrid([0, 1], [40.0, 80.0], [250.0, 500.0], [0, 1, 2, 3])
    )
    features = np.zeros((len(texture), 2 * 2 * 5))
    features[:, [0, 5]] = 1000 + speed[:, None]
    features[:, 10:] = (
        np.where(force > 300, 3.0, 1.0)[:, None] + np.where(turn % 2, 1.0, -1.0)[:, None]
    )
    path = tmp_path / "features.npy"
    np.save(path, features)
    design = Design(("A", "B"), texture.astype(np.int64), speed, force)
    halves = _split_variance(_VarianceJob(path, design, 5))
    sa, ra = halves["SA"], halves["RA"]
    assert (sa.texture, sa.speed, sa.force, sa.within) == pytest.approx((0, 1, 0, 0), abs=1e-9)
    assert sa.first_window == pytest.approx(1.0)
    assert (ra.texture, ra.speed, ra.force, ra.within) == pytest.approx((0, 0, 0.5, 0.5), abs=1e-9)
    assert ra.mean_by_force == pytest.approx((1.0, 3.0))


def curve(key: str, at_three: float, before: float, spread: float) -> Curve:
    """Two draws around a mean that is ``before`` up to two components and then ``at_three``."""
    draws = np.add.outer([-spread, spread], [before, before, at_three])
    return Curve(BY_KEY[key], draws, np.eye(16, dtype=np.int64), 800, 0, 0)


def compare(task: str, *curves: Curve) -> tuple[TaskComparison, TaskResult]:
    classes = tuple("ABCDEFGHIJKLMNOP")
    result = TaskResult(TASKS[task], classes, 3, 7200, 1 / 16, curves)
    found = compare_task(result, simulated=True)
    assert found is not None
    return found, result


def evidence() -> Ablations:
    sa = FeatureHalf(1.0, 0.01, 0.56, 0.30, 0.02, 0.4, (50.0, 85.0, 131.0))
    ra = FeatureHalf(1.0, 0.45, 0.23, 0.05, 0.01, 0.1, (2.0, 1.5, 1.0))
    keys = ("original", "speed", "force", "speed_force")
    alone = {"untrained-force": {key: {"SA": 0.2, "RA": 0.32} for key in keys}}
    return Ablations((250.0, 500.0, 1000.0), {key: {"SA": sa, "RA": ra} for key in keys}, alone, 3)


def test_a_reversed_pair_is_explained_by_numbers() -> None:
    found, result = compare(
        "untrained-force",
        curve("speed", 0.58, 0.3, 0.01), curve("force", 0.44, 0.5, 0.01),
        curve("force_blind", 0.27, 0.2, 0.01),
    )  # fmt: skip
    (pair,) = found.pairs
    assert pair.keys == ("force", "speed") and pair.agreement is Agreement.REVERSED
    sentences = "; ".join(explain(pair, result, evidence()))
    for words in (
        "ours differ by -14.0 points, Welch's p = 0.01, Cohen's d = -9.9",
        "it holds with 1–2 components",
        "from RA counts alone Force Scaled reaches 32.0 %",
        "force explains 30.0 % of the variance of SA rates in Force Scaled",
        "C acts on the SA current only: the mean RA count at 1000 g is 0.50 times that at 250 g",
        "40.0 % of what speed explains of SA rates in Speed Scaled lies in the first window",
        "with a texture-blind C Force Scaled reaches 27.0 %",
    ):
        assert words in sentences


def test_no_room_for_a_difference_is_not_a_reversal() -> None:
    high, low = curve("speed", 0.998, 0.99, 0.002), curve("original", 0.997, 0.9, 0.002)
    found, result = compare("textures", high, low)
    assert found.pairs[0].agreement is Agreement.TIED and not found.keys(Agreement.HOLDS)
    sentences = "; ".join(explain(found.pairs[0], result, None))
    assert "both are above 99%, which leaves no room for a difference" in sentences
    chance = compare(
        "untrained-both", curve("force", 0.06, 0.06, 0.02), curve("original", 0.07, 0.07, 0.01)
    )
    assert "both are near chance (6.2 %)" in "; ".join(explain(chance[0].pairs[0], chance[1], None))


def test_a_single_draw_decides_nothing() -> None:
    one = [
        Curve(BY_KEY[key], np.full((1, 3), share), np.eye(16, dtype=np.int64), 800, 0, 0)
        for key, share in (("speed", 0.9), ("original", 0.2))
    ]
    found, result = compare("textures", *one)
    assert found.pairs[0].agreement is Agreement.TIED
    assert explain(found.pairs[0], result, None)[0] == "a single draw has no spread to compare with"


def test_a_pair_that_holds_needs_no_explanation() -> None:
    found, result = compare(
        "textures", curve("speed", 0.9, 0.9, 0.01), curve("original", 0.5, 0.5, 0.01)
    )
    assert (
        len(found.keys(Agreement.HOLDS)) == 1 and explain(found.pairs[0], result, evidence()) == ()
    )


def test_tied_pairs_are_not_counted_as_reversed() -> None:
    pairs = [
        {"verdicts": [a, b], "wide": a is not b}
        for a, b in (
            (Agreement.HOLDS, Agreement.HOLDS), (Agreement.HOLDS, Agreement.REVERSED),
            (Agreement.TIED, Agreement.TIED), (Agreement.TIED, Agreement.REVERSED),
            (Agreement.REVERSED, Agreement.REVERSED),
        )
    ]  # fmt: skip
    tasks = {"textures": {"title": "Individual textures", "pairs": pairs}}
    assert summary_sentences(tasks) == [
        "Individual textures: of 5 comparisons 1 hold in every set, 1 hold in some, 1 cannot be "
        "told apart in any, 1 do not hold in some and cannot be told apart in others, "
        "1 hold in none",
        "All tasks: of 5 comparisons 2, 1 hold, set by set",
        "Of the 2 whose difference in the paper is larger than 2 standard deviations of the pair "
        "1, 0 hold",
    ]
