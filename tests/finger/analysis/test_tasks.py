"""Figures 4B, 4C and S5: exact predictions, sizes of sets, draws, errors and statistics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from rigctl.analysis.pca_lda import ScaledCovariance, SweepEngine
from rigctl.analysis.settings import AnalysisSettings
from rigctl.analysis.statistics import two_proportions, welch_each
from rigctl.errors import WrongUse
from rigctl.finger.analysis.scans import KINDS
from rigctl.finger.analysis.settings import FingerAnalysisSettings
from rigctl.finger.analysis.tasks import (
    DrawSettings,
    FingerResult,
    draw_accuracies,
    predict_new_session,
    run_finger_tasks,
)
from rigctl.finger.published import (
    DEPLOYED,
    FINGER_TASKS,
    NEW_SESSION,
    SAME_SESSION,
    TRAINED,
    UNTRAINED,
)
from rigctl.finger.values import ScanKind
from tests.finger.analysis.made_scans import made_data_set

EXACT = DrawSettings(engine=SweepEngine.SKLEARN)
SETS = [made_data_set(seed, contrast=0.01) for seed in (1, 2)]
RESULTS = {one.task.key: one for one in run_finger_tasks(SETS, DrawSettings(3))[0]}


@pytest.mark.parametrize("kind", KINDS)
def test_predictions_equal_exact_scikit_learns_trial_for_trial(kind: ScanKind) -> None:
    """The training mean is replaced in scikit-learn's own PCA, for every number of components."""
    data_set = made_data_set(7, repeats=4, contrast=0.008)
    train = np.sort(np.random.default_rng(3).permutation(100)[:75])
    features = data_set.training.features(kind)[train]
    labels = data_set.training.labels(data_set.textures)[train]
    rows = {NEW_SESSION.key: np.arange(100)}
    ours = predict_new_session(data_set, kind, train, rows, NEW_SESSION.k_max)[NEW_SESSION.key]
    assert ours.shape == (70, 100)
    tested = data_set.tested.features(kind)
    for k in range(1, 71):
        pca = PCA(k, svd_solver="full").fit(features)
        lda = LinearDiscriminantAnalysis(
            solver="lsqr", covariance_estimator=ScaledCovariance(75 / 70)
        ).fit(pca.transform(features), labels)
        pca.mean_ = data_set.calibration.features(kind).mean(axis=0)
        expected = lda.predict(pca.transform(tested))
        assert np.array_equal(ours[k - 1], expected), f"{k} components"
    truth = data_set.tested.labels(data_set.textures)
    assert 0.2 < (ours[10] == truth).mean() < 1.0 or kind is ScanKind.ORIGINAL


def test_both_engines_draw_the_same_accuracies() -> None:
    for kind in KINDS:
        own = draw_accuracies(SETS[0], kind, [0, 1], DrawSettings())
        sklearn = draw_accuracies(SETS[0], kind, [0, 1], EXACT)
        for (name, one), (other_name, other) in zip(own, sklearn, strict=True):
            assert name == other_name and np.array_equal(one, other)


def test_every_task_has_its_size() -> None:
    sizes = {
        key: (one.n_train, one.n_tested, one.k_max, len(one.accuracy[ScanKind.ORIGINAL]))
        for key, one in RESULTS.items()
    }
    # 50 training trials: folds of 37 and 38, 38 drawn; 20 slow and medium ones: 15 drawn.
    assert sizes == {
        SAME_SESSION.key: (38, 50, 32, 6),
        NEW_SESSION.key: (38, 50, 33, 6),
        TRAINED.key: (15, 20, 10, 6),
        UNTRAINED.key: (15, 30, 10, 6),
        DEPLOYED.key: (50, 50, 45, 2),
    }
    assert [one.k_max for one in FINGER_TASKS] == [70, 70, 25, 25, 95]


def test_mean_and_standard_error_are_over_all_draws() -> None:
    result = RESULTS[NEW_SESSION.key]
    values = result.accuracy[ScanKind.SPEED_SCALED]
    error = result.standard_error(ScanKind.SPEED_SCALED)
    assert error is not None
    np.testing.assert_allclose(error, values.std(axis=0, ddof=1) / np.sqrt(6))
    np.testing.assert_allclose(result.mean(ScanKind.SPEED_SCALED), values.mean(axis=0))


def test_differences_are_welchs_but_two_proportions_for_s5() -> None:
    result = RESULTS[UNTRAINED.key]
    original, scaled = (result.accuracy[kind] for kind in KINDS)
    assert result.differences()[4:5] == welch_each(scaled[:, 4:5], original[:, 4:5])
    deployed = RESULTS[DEPLOYED.key]
    counts = [round(50 * float(deployed.accuracy[kind][:, 9].sum())) for kind in KINDS]
    assert deployed.differences()[9] == two_proportions(counts[1], counts[0], 100)
    proportion = counts[1] / 100
    error = deployed.standard_error(ScanKind.SPEED_SCALED)
    assert error is not None
    assert error[9] == pytest.approx(np.sqrt(proportion * (1 - proportion) / 100))


def test_speed_scaling_wins_where_textures_are_places_on_the_plate() -> None:
    result = RESULTS[NEW_SESSION.key]
    assert result.mean(ScanKind.SPEED_SCALED)[9] > 0.5 > result.mean(ScanKind.ORIGINAL)[9]
    assert result.differences()[9].stars == "**"


def test_labels_that_mean_nothing_are_at_chance() -> None:
    """Negative control: with shuffled textures in training, nothing carries over."""
    training = SETS[0].training
    shuffled = np.random.default_rng(1).permutation(training.texture)
    blind = replace(SETS[0], training=replace(training, texture=shuffled))
    (result,) = (
        one for one in run_finger_tasks([blind], DrawSettings(4))[0] if one.task is NEW_SESSION
    )
    assert abs(result.mean(ScanKind.SPEED_SCALED)[:15].mean() - 0.2) < 0.1


def test_equal_seeds_draw_equal_trials_and_others_do_not() -> None:
    def accuracy(seed: int) -> FingerResult:
        return run_finger_tasks(SETS[:1], DrawSettings(2, seed))[0][1]

    kind = ScanKind.SPEED_SCALED
    assert np.array_equal(accuracy(4).accuracy[kind], accuracy(4).accuracy[kind])
    assert not np.array_equal(accuracy(4).accuracy[kind], accuracy(5).accuracy[kind])


def test_the_calibrations_mean_undoes_a_shift_of_the_new_session() -> None:
    """Negative control: left at the training mean, the shifted session is misread."""
    kind, one = ScanKind.SPEED_SCALED, SETS[0]
    shift = np.random.default_rng(2).uniform(50, 300, one.tested.windows.shape[1:])
    moved = replace(
        one,
        calibration=replace(one.calibration, windows=one.calibration.windows + shift),
        tested=replace(one.tested, windows=one.tested.windows + shift),
    )
    train, rows = np.arange(50), {"new": np.arange(50)}
    plain = predict_new_session(one, kind, train, rows, 20)["new"]
    assert np.array_equal(predict_new_session(moved, kind, train, rows, 20)["new"], plain)
    uncalibrated = replace(moved, calibration=one.calibration)
    wrong = predict_new_session(uncalibrated, kind, train, rows, 20)["new"]
    truth = one.tested.labels(one.textures)
    assert (wrong[19] == truth).mean() < (plain[19] == truth).mean() - 0.2


def test_profiles_that_were_not_recorded_cost_figure_4c_only() -> None:
    one = SETS[0]
    slow_only = replace(one, tested=one.tested.of_profiles(["slow", "medium"]))
    results, (remark,) = run_finger_tasks([slow_only], DrawSettings(1))
    assert [result.task.figure for result in results] == ["Fig. 4B", "Fig. 4B", "Fig. S5"]
    assert (
        "Figure 4C is left out: it tests the velocity profiles others than slow, medium" in remark
    )


def test_an_analysis_file_changes_profiles_shares_and_components() -> None:
    finger = FingerAnalysisSettings(
        trained_share=0.5, session_components=7, trained_profiles=("fast",)
    )
    settings = DrawSettings(1, analysis=AnalysisSettings(finger=finger))
    results, remarks = run_finger_tasks(SETS[:1], settings)
    found = {one.task.key: one for one in results}
    assert not remarks and found[SAME_SESSION.key].k_max == found[NEW_SESSION.key].k_max == 7
    # Two scans of each of five textures and five profiles: ten fast ones, half of them drawn.
    assert (found[TRAINED.key].n_train, found[TRAINED.key].n_tested) == (5, 10)
    assert found[UNTRAINED.key].n_tested == 40


def test_too_few_trials_are_refused() -> None:
    one = SETS[0]
    few = replace(one, training=one.training.of_profiles(["slow"]))
    with pytest.raises(WrongUse, match="too few for a classifier"):
        run_finger_tasks([few], DrawSettings(1))
    with pytest.raises(WrongUse, match="one draw or more"):
        DrawSettings(0)
