"""The classifier on the board gives the host's answers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl import host_build
from rigctl.errors import WrongUse
from rigctl.finger import board_messages
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.board_messages import (
    N_FEATURES,
    N_TAXELS,
    N_WINDOWS,
    Answer,
    BoardPrediction,
    Message,
    RequestType,
    Result,
    WindowReport,
    model_header,
)
from rigctl.finger.decoder import FingerDecoder
from tests.firmware.finger.scans import synthetic_scan, through_host_build

Floats = NDArray[np.float64]
COMPONENTS, CLASSES = 25, ("A", "B", "D", "L", "N")


SCANS = [synthetic_scan(number) for number in range(10)]


def _features(decoded: list[Message]) -> dict[int, Floats]:
    """Return the feature vector of each scan from its windows, float64 (180,)."""
    features: dict[int, Floats] = {}
    for window in decoded:
        if isinstance(window, WindowReport) and window.window < N_WINDOWS:
            vector = features.setdefault(window.scan, np.zeros((N_TAXELS, N_WINDOWS)))
            vector[:, window.window] = window.rates_hz
    return {scan: vector.ravel() for scan, vector in features.items()}


@pytest.fixture(scope="module")
def features() -> dict[int, Floats]:
    board = FingerFirmware()
    _, decoded = FingerDecoder().feed(through_host_build(SCANS, board))
    board.close()
    return _features(decoded)


@dataclass(frozen=True)
class RandomModel:
    """Random axes and coefficients around a mean."""

    mean: Floats
    axes: Floats
    coefficients: Floats
    intercepts: Floats

    def discriminants(self, features: Floats) -> Floats:
        scores = (features - self.mean) @ self.axes
        discriminants: Floats = self.coefficients @ scores + self.intercepts
        return discriminants

    def header(self) -> str:
        return model_header(self.mean, self.axes, self.coefficients, self.intercepts, CLASSES)


@pytest.fixture(scope="module")
def model(features: dict[int, Floats]) -> RandomModel:
    rng = np.random.default_rng(5)
    axes, _ = np.linalg.qr(rng.standard_normal((N_FEATURES, COMPONENTS)))
    coefficients = rng.standard_normal((len(CLASSES), COMPONENTS))
    mean = np.mean(list(features.values()), axis=0)
    return RandomModel(mean, axes, coefficients, rng.standard_normal(len(CLASSES)))


@pytest.fixture(scope="module")
def library(model: RandomModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("classifier")
    (folder / "model.h").write_text(model.header())
    define = f'FINGER_MODEL="{folder / "model.h"}"'
    return host_build.build("finger", folder / "finger.so", [define])


def _check(sent: bytes, features: dict[int, Floats], model: RandomModel) -> None:
    _, decoded = FingerDecoder().feed(sent)
    predictions = {m.scan: m for m in decoded if isinstance(m, BoardPrediction)}
    assert set(predictions) == set(features)
    for scan, prediction in predictions.items():
        expected = model.discriminants(features[scan])
        assert np.allclose(prediction.discriminants, expected, rtol=1e-12, atol=1e-9)
        assert prediction.best == np.argmax(expected)


def test_the_board_predicts_what_the_host_predicts(
    library: Path, model: RandomModel, features: dict[int, Floats]
) -> None:
    board = FingerFirmware(library)
    _check(through_host_build(SCANS, board), features, model)
    board.close()
    assert len({int(np.argmax(model.discriminants(x))) for x in features.values()}) > 1


def test_a_calibrations_mean_replaces_the_training_mean(
    library: Path, model: RandomModel, features: dict[int, Floats]
) -> None:
    mean = model.mean + np.random.default_rng(6).uniform(-30, 30, N_FEATURES)
    requests = [
        board_messages.set_mean(window, row.tolist())
        for window, row in enumerate(mean.reshape(N_TAXELS, N_WINDOWS).T)
    ]
    board = FingerFirmware(library)
    sent = through_host_build(SCANS, board, b"".join(requests))
    _check(sent, features, replace(model, mean=mean))
    board.close()


def test_a_board_without_a_model_refuses_a_mean() -> None:
    board = FingerFirmware()
    board.boot(0)
    board.receive(board_messages.set_mean(0, [0.0] * N_TAXELS))
    _, decoded = FingerDecoder().feed(board.take_sent())
    assert decoded[-1] == Answer(RequestType.SET_MEAN, Result.NO_MODEL, 0)
    board.close()


def test_a_model_of_another_size_is_refused() -> None:
    with pytest.raises(WrongUse, match="180 features"):
        model_header(np.zeros(720), np.zeros((720, 5)), np.zeros((5, 5)), np.zeros(5), CLASSES)
    with pytest.raises(WrongUse, match="room for 8 classes"):
        model_header(
            np.zeros(180), np.zeros((180, 5)), np.zeros((9, 5)), np.zeros(9), list("ABCDEFGHI")
        )
