"""Splits by mounting: nothing of a mounting that is tested was trained on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.analysis.splits import make_splits
from rigctl.analysis.trial_set import Design, number_mountings
from rigctl.errors import WrongUse

PAPER_SPEEDS, PAPER_FORCES = (40.0, 60.0, 80.0, 100.0, 120.0), (250.0, 500.0, 1000.0)


def design(
    n: int,
    mounts: int = 2,
    speeds: tuple[float, ...] = PAPER_SPEEDS,
    forces: tuple[float, ...] = PAPER_FORCES,
) -> Design:
    """Return ``n`` trials of each of three textures, speeds and forces in each mounting."""
    axes = np.meshgrid(np.arange(3), speeds, forces, np.arange(mounts), indexing="ij")
    texture, speed, force, mount = (np.repeat(axis.ravel(), n) for axis in axes)
    return Design(
        ("A", "B", "G"), texture.astype(np.int64), speed, force, mount=mount.astype(np.int64)
    )


def without(whole: Design, kept: NDArray[np.bool_]) -> Design:
    columns = (whole.texture, whole.speed_mm_s, whole.force_g)
    return Design(whole.textures, *(c[kept] for c in columns), mount=whole.mount[kept])


@pytest.mark.parametrize("n", [1, 2, 8])
@pytest.mark.parametrize("mounts", [2, 3, 9])
def test_a_mounting_that_is_left_out_is_never_trained_on(n: int, mounts: int) -> None:
    whole = design(n, mounts)
    fits = make_splits(whole, "leave-mount-out", 0, 0)
    for fit in fits:
        trained = set(whole.mount[fit.train].tolist())
        for key, rows in fit.tests.items():
            assert not set(fit.train.tolist()) & set(rows.tolist())
            tested = set(whole.mount[rows].tolist())
            assert tested <= trained if key.startswith("trained") else not tested & trained
    left_out = [fit.tests["leave-mount-out"] for fit in fits if "leave-mount-out" in fit.tests]
    assert set(whole.mount[np.concatenate(left_out)].tolist()) == set(range(mounts))
    assert len(left_out) == min(mounts, 4)


def test_both_mountings_are_tested_with_as_many_trials() -> None:
    fits = make_splits(design(8), "leave-mount-out", 0, 0)
    counts = [(len(fit.train), {key: len(rows) for key, rows in fit.tests.items()}) for fit in fits]
    everything = (3 * 15 * 6, {"trained-mount": 90, "leave-mount-out": 90})
    slower = (
        3 * 6 * 6,
        {"trained-mount-untrained-speed": 24, "leave-mount-out-untrained-speed": 24},
    )
    assert counts == [everything, everything, slower, slower]


def test_untrained_speeds_are_tested_only_where_the_extrapolation_fits() -> None:
    fits = make_splits(design(4, speeds=(40.0, 120.0)), "leave-mount-out", 0, 0)
    assert [sorted(fit.tests) for fit in fits] == [["leave-mount-out", "trained-mount"]] * 2
    whole = design(4)
    slower = make_splits(whole, "leave-mount-out", 0, 0)[-1]
    assert set(whole.speed_mm_s[slower.train].tolist()) == {40.0, 60.0, 80.0}
    for rows in slower.tests.values():
        assert set(whole.speed_mm_s[rows].tolist()) == {100.0, 120.0}
        assert set(whole.force_g[rows].tolist()) == {250.0, 500.0}


def test_a_plate_that_was_mounted_once_is_left_out() -> None:
    whole = design(4)
    torn = without(whole, (whole.texture < 2) | (whole.mount == 0))
    for fit in make_splits(torn, "leave-mount-out", 0, 0):
        assert set(torn.texture[fit.train].tolist()) == {0, 1}
    torn = without(whole, (whole.texture < 1) | (whole.mount == 0))
    with pytest.raises(WrongUse, match="give mounts = 2 in the protocol"):
        make_splits(torn, "leave-mount-out", 0, 0)


def test_a_condition_that_one_mounting_lacks_costs_no_other_trial() -> None:
    whole = design(4)
    gone = (whole.mount == 1) & (whole.speed_mm_s == 40) & (whole.texture == 0)
    torn = without(whole, ~gone)
    first, second, *_ = make_splits(torn, "leave-mount-out", 0, 0)
    assert len(first.train) + len(second.train) == (2 * 45 - 3) * 3


def test_a_mounting_with_one_texture_alone_is_no_training_set() -> None:
    whole = design(4)
    trained = np.isin(whole.speed_mm_s, (40, 60, 80)) & np.isin(whole.force_g, (250, 500))
    torn = without(whole, (whole.mount == 0) | (whole.texture == 0) | ~trained)
    slower = make_splits(torn, "leave-mount-out", 0, 0)[2:]
    assert [set(torn.texture[fit.train].tolist()) for fit in slower] == [{0, 1, 2}]
    assert set(torn.mount[slower[0].train].tolist()) == {0}


def test_draws_are_repeatable_and_differ_between_iterations() -> None:
    whole = design(8)
    first, again, other = (
        make_splits(whole, "leave-mount-out", 1, draw)[0].train for draw in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(np.sort(first), np.sort(other))


def test_a_session_is_a_mounting_of_its_own_for_each_texture() -> None:
    texture = np.array([0, 0, 0, 1, 1, 1, 2])
    places = [(0, 1), (0, 2), (1, 1), (0, 1), (1, 1), (1, 1), (1, 4)]
    np.testing.assert_array_equal(number_mountings(texture, places), [0, 1, 2, 0, 1, 1, 0])
