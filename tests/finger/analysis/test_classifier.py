"""The live experiment's classifier: scikit-learn's answers, its file, and what it refuses."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from rigctl.analysis.pca_lda import ScaledCovariance, log_posteriors
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import PRESETS
from rigctl.errors import SessionError, WrongUse
from rigctl.finger.analysis.classifier import (
    FingerClassifier,
    board_coefficients,
    calibrate_finger_model,
    check_finger_model,
    nearest_distances,
    stage_features,
    train_finger_model,
)
from rigctl.finger.analysis.scans import KINDS, FingerDataSet, FingerEncoding
from rigctl.finger.model_file import FingerModel, load_finger_model, save_finger_model
from rigctl.finger.values import ScanKind
from rigctl.session.hdf5_file import write_attributes
from tests.finger.analysis.made_scans import made_data_set
from tests.finger.analysis.models import ENCODING, INFO, calibrated_model


@cache
def data_set() -> FingerDataSet:
    return made_data_set(1, contrast=0.01)


@cache
def trained() -> FingerModel:
    return calibrated_model(data_set())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n_windows", [1, 4, 19, 20])
def test_every_stage_predicts_like_exact_scikit_learn(kind: ScanKind, n_windows: int) -> None:
    model = calibrated_model(data_set(), kind)
    found = FingerClassifier(model).predict_scans(data_set().tested).probabilities[n_windows - 1]
    training = stage_features(data_set().training, kind, n_windows)
    labels = data_set().training.labels(model.textures)
    pca = PCA(model.stages[n_windows - 1].components, svd_solver="full").fit(training)
    lda = LinearDiscriminantAnalysis(
        solver="lsqr", covariance_estimator=ScaledCovariance(50 / 45)
    ).fit(pca.transform(training), labels)
    mean = data_set().calibration.features(kind).mean(axis=0).reshape(9, 20)
    pca.mean_ = mean[:, :n_windows].reshape(-1)
    scores = pca.transform(stage_features(data_set().tested, kind, n_windows))
    assert np.array_equal(found.argmax(axis=1), lda.predict(scores))


def test_the_default_has_25_components_and_few_windows_fewer() -> None:
    assert trained().stages[-1].components == 25 and trained().stages[0].components == 9
    assert trained().n_windows == 20 and trained().mean.shape == (180,)


def test_a_file_holds_every_bit_of_a_model(tmp_path: Path) -> None:
    for name, model in (("calibrated", trained()), ("plain", replace(trained(), calibration=None))):
        path = tmp_path / f"{name}.h5"
        save_finger_model(model, path)
        read = load_finger_model(path)
        assert _values(read) == _values(model)
        windows = data_set().tested.windows[0]
        before, after = (FingerClassifier(m).answer(windows) for m in (model, read))
        assert before.probabilities.tobytes() == after.probabilities.tobytes()


def test_a_calibration_replaces_an_earlier_one() -> None:
    other = calibrate_finger_model(trained(), made_data_set(2).calibration)
    assert not np.array_equal(other.mean, trained().mean)
    assert np.array_equal(
        calibrate_finger_model(other, data_set().calibration).mean, trained().mean
    )


def test_calibration_trials_are_scored_without_their_own_part_of_the_mean() -> None:
    kind, scans = ScanKind.SPEED_SCALED, data_set().calibration
    assert trained().calibration is not None
    left_out = calibrate_finger_model(trained(), scans.select(np.arange(1, len(scans))))
    first = scans.features(kind)[:1]
    centred = replace(trained().stages[-1], mean=left_out.mean)
    np.testing.assert_allclose(
        trained().calibration.logs[-1, :1], log_posteriors(centred, first), rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(
        trained().calibration.distances[-1, :1], nearest_distances(centred, first), rtol=1e-9
    )


def test_the_boards_coefficients_give_the_same_discriminants() -> None:
    coefficients, intercepts = board_coefficients(trained())
    features = data_set().tested.features(ScanKind.SPEED_SCALED)
    scores = (features - trained().mean) @ trained().stages[-1].axes
    discriminants = scores @ coefficients.T + intercepts
    found = FingerClassifier(trained()).predict(features)
    assert np.array_equal(discriminants.argmax(axis=1), found)


@pytest.mark.parametrize(
    ("encoding", "message"),
    [
        (ENCODING._replace(sensor="finger 2"), "sensor 'finger 1', not 'finger 2'"),
        (ENCODING._replace(normalisation=Normalisation.full_scale(9, 900)), "other taxel ranges"),
        (ENCODING._replace(parameters=PRESETS["explicit"]), "other encoder parameters"),
        (ENCODING._replace(reference_um_per_s=120_000), "100 mm/s, not 120"),
    ],
)
def test_a_model_of_another_finger_is_refused(encoding: FingerEncoding, message: str) -> None:
    check_finger_model(trained(), ENCODING)
    with pytest.raises(WrongUse, match=message):
        check_finger_model(trained(), encoding)


def test_other_plates_than_the_models_do_not_calibrate_it() -> None:
    scans = data_set().calibration.select(data_set().calibration.texture != "L")
    with pytest.raises(WrongUse, match="the model knows A, B, D, L, N"):
        calibrate_finger_model(trained(), scans)
    one = train_finger_model(data_set().training, ScanKind.ORIGINAL, ENCODING, INFO)
    with pytest.raises(WrongUse, match="one calibration trial"):
        calibrate_finger_model(
            replace(one, textures=("A",)), scans.select(scans.texture == "A").select(np.arange(1))
        )


def test_a_drums_model_or_a_damaged_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.h5"
    save_finger_model(trained(), path)
    with pytest.raises(WrongUse, match="already exists"):
        save_finger_model(trained(), path)
    with h5py.File(path, "r+") as file:
        del file["windows/07/factor"]
    with pytest.raises(SessionError, match=r"is damaged: windows/07/factor is missing"):
        load_finger_model(path)
    with h5py.File(path, "r+") as file:
        write_attributes(file, {"layout": "rigctl-model"})
    with pytest.raises(SessionError, match="not a model of the finger: give a file that rigctl"):
        load_finger_model(path)


def test_a_model_needs_components_and_trials() -> None:
    with pytest.raises(WrongUse, match="one component"):
        train_finger_model(data_set().training, ScanKind.ORIGINAL, ENCODING, INFO, 0)
    alike = data_set().training.select(data_set().training.texture == "A")
    with pytest.raises(WrongUse, match="two classes"):
        train_finger_model(alike, ScanKind.ORIGINAL, ENCODING, INFO)


def _values(model: FingerModel) -> list[object]:
    """Return every value of a model, arrays as bytes."""
    parts = [model, *model.stages, *([model.calibration] if model.calibration else [])]
    values: list[object] = []
    for part in parts:
        for field in fields(part):
            value = getattr(part, field.name)
            if isinstance(value, np.ndarray):
                values += [field.name, value.dtype, value.shape, value.tobytes()]
            elif field.name not in ("stages", "calibration", "normalisation"):
                values.append(value)
    return [*values, model.normalisation.low.tobytes(), model.normalisation.source]
