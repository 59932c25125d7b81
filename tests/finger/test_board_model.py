"""A trained model on the board: the firmware built with its header answers as the host does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl import host_build
from rigctl.analysis.pca_lda import log_posteriors
from rigctl.cli import main
from rigctl.finger import board_messages
from rigctl.finger.analysis.classifier import FingerClassifier, centred_stages
from rigctl.finger.analysis.scans import read_scans
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.board_messages import BoardPrediction
from rigctl.finger.decoder import FingerDecoder
from rigctl.finger.model_file import FingerModel, load_finger_model
from rigctl.finger.session import FingerSession
from rigctl.finger.values import ScanKind, Stage
from tests.finger.conftest import Trained
from tests.firmware.finger.scans import SyntheticScan, through_host_build


def recorded(folder: Path, stage: str) -> list[SyntheticScan]:
    """Return the committed scans of a stage: readings, and the velocities that the board used."""
    with FingerSession.open(folder) as session:
        return [
            SyntheticScan(i, session.samples(i), session.velocities_um_s(i).tolist())
            for i in session.committed()
            if session.trials["stage"][i] == stage
        ]


def board_answers(
    folder: Path, header: Path, model: FingerModel, scans: list[SyntheticScan]
) -> list[BoardPrediction]:
    """Return what the firmware with this header says of scans, with the model's ranges."""
    library = host_build.build("finger", folder / "finger.so", [f'FINGER_MODEL="{header}"'])
    ranges = model.normalisation
    board = FingerFirmware(library)
    settings = board_messages.set_ranges(ranges.low.tolist(), ranges.high.tolist())
    _, decoded = FingerDecoder().feed(through_host_build(scans, board, settings))
    board.close()
    return [message for message in decoded if isinstance(message, BoardPrediction)]


@pytest.mark.parametrize("calibrated", [True, False])
def test_the_board_answers_as_the_classifier(
    trained: Trained, tmp_path: Path, calibrated: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, stage = (
        (trained.calibration, "calibrate") if calibrated else (trained.training, "train")
    )
    header = tmp_path / "model.h"
    assert main(["realtime", "board", str(folder), "--out", str(header)]) == 0
    mean = "calibration" if calibrated else "training"
    assert f"3 textures, 10 components, the mean of the {mean}" in capsys.readouterr().out
    assert header.read_text().startswith("// Trained on 18 simulated scans.")

    model = load_finger_model(folder / "model-speed-scaled.h5")
    answers = board_answers(tmp_path, header, model, scans := recorded(folder, stage))
    features = read_scans(folder).scans.of_stage(Stage(stage)).features(ScanKind.SPEED_SCALED)
    assert len(answers) == len(scans) == len(features) >= 12
    expected = log_posteriors(centred_stages(model)[-1], features)
    predicted = FingerClassifier(model).predict(features)
    for answer, logs, best in zip(answers, expected, predicted, strict=True):
        discriminants = np.array(answer.discriminants)
        normal = discriminants - np.logaddexp.reduce(discriminants)
        assert np.allclose(normal, logs, rtol=1e-9, atol=1e-7)
        assert answer.best == best


def test_a_model_of_other_features_is_refused(
    trained: Trained, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = tmp_path / "model.h"
    model = trained.training / "model-original.h5"
    assert main(["realtime", "board", str(model), "--out", str(header)]) == 2
    assert "is a model of Original features" in capsys.readouterr().err
    assert not header.exists()


def test_a_missing_model_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["realtime", "board", str(tmp_path), "--out", str(tmp_path / "model.h")]) == 2
    assert "train one with `rigctl realtime train`" in capsys.readouterr().err
