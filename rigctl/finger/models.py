"""The classifiers of an experiment: trained after the training scans, centred by the calibration.

Every representation gets a model, so that they can be compared on the same scans.
"""

from __future__ import annotations

from pathlib import Path

from rigctl.finger.analysis.classifier import (
    calibrate_finger_model,
    check_finger_model,
    train_finger_model,
)
from rigctl.finger.analysis.scans import read_scans, training_info
from rigctl.finger.model_file import FingerModel, load_finger_model, save_finger_model
from rigctl.finger.values import ScanKind, Stage


def model_name(kind: ScanKind) -> str:
    """Return the file name of a representation's model in a session's folder."""
    return f"model-{kind.key}.h5"


def train_models(folder: Path, components: int, made_utc: str) -> list[Path]:
    """Train a model of each representation that a session has; return the files.

    Raises WrongUse where the session has too few training scans.
    """
    recorded = read_scans(folder)
    scans, training = recorded.scans.of_stage(Stage.TRAIN), training_info(recorded, made_utc)
    paths = []
    for kind in scans.kinds:
        model = train_finger_model(scans, kind, recorded.encoding, training, components)
        paths.append(_save_new(folder / model_name(kind), model))
    return paths


def calibrate_models(source: Path, folder: Path) -> list[Path]:
    """Centre the models of ``source`` by a session's calibration scans; return the new files.

    Raises WrongUse where the scans are of another sensor, other ranges or other textures.
    """
    recorded = read_scans(folder)
    scans = recorded.scans.of_stage(Stage.CALIBRATE)
    files = [source]
    if source.is_dir():
        files = [source / model_name(kind) for kind in scans.kinds]
    paths = []
    for file in files:
        trained = load_finger_model(file)
        check_finger_model(trained, recorded.encoding)
        model = calibrate_finger_model(trained, scans)
        paths.append(_save_new(folder / model_name(ScanKind(model.representation)), model))
    return paths


def _save_new(path: Path, model: FingerModel) -> Path:
    """Write a model; one of an earlier sitting is replaced."""
    path.unlink(missing_ok=True)
    save_finger_model(model, path)
    return path
