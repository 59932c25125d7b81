"""The paper's draws and splits, and the tasks on a small recording by both engines."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.cache import Resources
from rigctl.analysis.executors import local_executor
from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.splits import make_splits, stratified_folds
from rigctl.analysis.tasks import SweepSettings, TaskResult, run_tasks
from rigctl.analysis.trial_set import Design, join_sessions
from rigctl.encoder.parameters import DEFAULT
from rigctl.errors import WrongUse
from tests.analysis.recordings import record

PAPER_SPEEDS, PAPER_FORCES = (40.0, 60.0, 80.0, 100.0, 120.0), (250.0, 500.0, 1000.0)


def design(
    n: int,
    textures: str = "ABCDEFGHIJKLMNOP",
    speeds: tuple[float, ...] = PAPER_SPEEDS,
) -> Design:
    t, v, f = np.meshgrid(np.arange(len(textures)), speeds, PAPER_FORCES, indexing="ij")
    texture, speed, force = (np.repeat(x.ravel(), n) for x in (t, v, f))
    return Design(tuple(textures), texture.astype(np.int64), speed, force)


def test_the_papers_numbers_of_trials_come_out() -> None:
    whole = design(100)
    folds = make_splits(whole, "folds", 1, 0)
    assert [len(fit.train) for fit in folds] == [6000] * 4
    assert [len(fit.tests["textures"]) for fit in folds] == [2000] * 4
    drawn = np.concatenate([fit.tests["textures"] for fit in folds])
    assert len(np.unique(drawn)) == 8000
    assert (np.bincount(whole.texture[drawn]) == 500).all()
    (fit,) = make_splits(whole, "extrapolation", 1, 0)
    assert len(fit.train) == 7200
    assert {key: len(rows) for key, rows in fit.tests.items()} == {
        "untrained-both": 800, "untrained-force": 1200,
        "untrained-speed": 1600, "trained-both": 2400,
    }  # fmt: skip
    assert not set(fit.train) & set(np.concatenate(list(fit.tests.values())).tolist())
    assert set(whole.speed_mm_s[fit.train]) == {40.0, 60.0, 80.0}
    assert set(whole.force_g[fit.tests["untrained-both"]]) == {1000.0}
    assert whole.groups == ("smooth", "circular ridges", "rectangular ridges", "waves")


def test_folds_test_every_row_once_and_spread_the_classes() -> None:
    labels = np.repeat([0, 1, 2], [9, 6, 5])
    folds = stratified_folds(labels, 4, seed=1)
    tested = np.concatenate([test for _, test in folds])
    assert sorted(tested.tolist()) == list(range(20))
    assert [len(test) for _, test in folds] == [5, 5, 5, 5]
    for train, test in folds:
        assert not set(train) & set(test)
        assert (abs(np.bincount(labels[test], minlength=3) - np.array([9, 6, 5]) / 4) < 1).all()
    again = stratified_folds(labels, 4, seed=1)
    assert all((a[1] == b[1]).all() for a, b in zip(folds, again, strict=True))
    with pytest.raises(WrongUse, match="smallest class has 5"):
        stratified_folds(labels, 6, seed=1)


def test_draws_are_repeatable_and_differ_between_iterations() -> None:
    small = design(4, "ABG")
    for family in ("folds", "extrapolation", "leave-speed-out"):
        first, again, other = (make_splits(small, family, 1, i)[0].train for i in (0, 0, 1))
        np.testing.assert_array_equal(first, again)
        assert not np.array_equal(np.sort(first), np.sort(other))


def test_a_level_that_is_left_out_is_never_trained_on() -> None:
    small = design(4, "AB")
    for family, levels in (
        ("leave-speed-out", small.speed_mm_s),
        ("leave-force-out", small.force_g),
    ):
        fits = make_splits(small, family, 0, 0)
        assert len(fits) == len(np.unique(levels))
        for fit in fits:
            tested = fit.tests[family]
            assert len(set(levels[tested])) == 1
            assert not set(levels[tested]) & set(levels[fit.train])


@pytest.fixture(scope="module")
def representations(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RepresentationSet]:
    folder = tmp_path_factory.mktemp("set")
    session = record(
        folder / "session", "ABG", repeats=3, travel_mm=12.0,
        speeds=(40, 60, 80, 120), forces=(250, 500, 1000),
    )  # fmt: skip
    yield represent(join_sessions([session]), DEFAULT, folder)


def test_both_engines_give_equal_answers(representations: RepresentationSet) -> None:
    ours, remarks = run_tasks(representations, SweepSettings(iterations=2, k_max=5))
    theirs, _ = run_tasks(
        representations, SweepSettings(iterations=2, k_max=5, engine=SweepEngine.SKLEARN)
    )
    assert remarks == ()
    assert [r.task.figure[-1] for r in ours] == list("ABCDEF")
    for one, other in zip(ours, theirs, strict=True):
        for a, b in zip(one.curves, other.curves, strict=True):
            np.testing.assert_array_equal(a.accuracy, b.accuracy)
            np.testing.assert_array_equal(a.confusion, b.confusion)
    textures = _of(ours, "textures")
    assert textures.k_max == 5 and textures.chance == pytest.approx(1 / 3)
    assert textures.curves[0].accuracy.shape == (2, 5)
    assert textures.curves[0].confusion.sum() == 2 * textures.curves[0].n_tested
    assert textures.curves[3].mean[-1] > 0.7


def test_processes_give_equal_answers(representations: RepresentationSet) -> None:
    chosen = SweepSettings(iterations=2, k_max=4, tasks=("textures",))
    alone, _ = run_tasks(representations, chosen)
    with local_executor(2) as executor:
        together, _ = run_tasks(representations, chosen, Resources(executor))
    for a, b in zip(alone[0].curves, together[0].curves, strict=True):
        np.testing.assert_array_equal(a.accuracy, b.accuracy)


def test_a_reduced_number_of_components_is_reported(representations: RepresentationSet) -> None:
    results, remarks = run_tasks(
        representations, SweepSettings(iterations=1, tasks=("textures", "leave-force-out"))
    )
    textures = _of(results, "textures")
    assert textures.k_max == textures.n_train - 3 < 50
    assert any("individual textures: up to" in remark for remark in remarks)
    assert textures.curves[0].sd is None
    assert _of(results, "leave-force-out").classes == ("A", "B", "G")


def test_a_design_with_other_levels_leaves_one_out(tmp_path: Path) -> None:
    session = record(tmp_path / "session", "AX", repeats=2, travel_mm=12.0)
    representations = represent(join_sessions([session]), DEFAULT, tmp_path)
    results, remarks = run_tasks(representations, SweepSettings(iterations=1, k_max=2))
    assert [r.task.key for r in results] == ["textures", "leave-speed-out", "leave-force-out"]
    assert any("does not fit this set" in remark for remark in remarks)
    assert any("names under [groups]" in remark for remark in remarks)
    with pytest.raises(
        WrongUse, match=r"^untrained speed and force, untrained force, .*another speed"
    ):
        run_tasks(representations, SweepSettings(tasks=("extrapolation",)))
    with pytest.raises(WrongUse, match="no task 'everything'"):
        SweepSettings(tasks=("everything",))


def test_components_without_variance_are_set_aside_not_divided_by() -> None:
    rng = np.random.default_rng(2)
    labels = np.repeat([0, 1, 2], 12)
    features = np.zeros((36, 30))
    features[:, 0] = 100.0 * labels
    features[:, 1:4] = rng.normal(0, 1, (36, 3))
    fit = [Split(np.arange(0, 36, 2), {"textures": np.arange(1, 36, 2)})]
    for engine in SweepEngine:
        (found,) = predict_splits(features, {"textures": labels}, fit, 8, engine)
        assert found.beyond_rank == 4
        assert found.predictions["textures"].shape == (8, 18)
    (ours,) = predict_splits(np.full((36, 5), 7.0), {"textures": labels}, fit, 3, SweepEngine.OWN)
    assert ours.without_variance >= 1
    assert set(ours.predictions["textures"].ravel()) <= {0, 1, 2}


def _of(results: list[TaskResult], key: str) -> TaskResult:
    return next(r for r in results if r.task.key == key)
