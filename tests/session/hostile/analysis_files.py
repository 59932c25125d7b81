"""Small models and a file of spikes, as values that need no recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.finger.model_file import (
    FingerCalibration,
    FingerModel,
    save_finger_model,
)
from rigctl.session.analysis_file import EncodingInfo, SpikeFileWriter
from rigctl.session.model_file import Classifier, Model, TrainingInfo, save_model
from rigctl.session.sensor_layout import SensorLayout

TEXTURES = ("A", "B")
TRAINING = TrainingInfo(
    "2026-11-23T12:00:00Z", "1.0", "0badcafe", 1, True, 4, (40.0,), (250.0,),
    ({"path": "s", "content": "0" * 64, "n_taxels": 2, "wiring": [0, 1], "rig": "virtual"},),
)  # fmt: skip
RANGES = Normalisation.full_scale(2)


def force_matrix() -> ForceMatrix:
    shape = (2, 2, 1, 1)
    ones = np.ones(shape)
    return ForceMatrix(TEXTURES, (40.0,), (250.0,), 250.0, ones, ones.astype(np.int8), ones, ones)


def write_model(path: Path) -> Path:
    features = FeatureLayout(2, scaled=False)
    p, k = features.n_features(2), 2
    save_model(
        Model(
            np.zeros(p), np.ones((p, k)), np.ones(k), np.eye(k), np.ones((k, 2)), np.zeros(2),
            np.zeros(1, np.int64),
            "Original", "original", "texture", TEXTURES, EncoderParameters(), RANGES, features,
            c=force_matrix(), training=TRAINING,
        ),
        path,
    )  # fmt: skip
    return path


def write_finger_model(path: Path) -> Path:
    stages = tuple(
        Classifier(
            np.zeros(2 * n), np.ones((2 * n, 1)), np.ones(1), np.eye(1), np.ones((1, 2)),
            np.zeros(2), np.zeros(0, np.int64),
        )
        for n in (1, 2)
    )  # fmt: skip
    calibration = FingerCalibration(
        np.zeros(4), np.array([0, 1]), np.zeros((2, 2, 2)), np.zeros((2, 2))
    )
    save_finger_model(
        FingerModel(
            "original", TEXTURES, EncoderParameters(), RANGES, 40_000, "skin", stages, TRAINING,
            calibration,
        ),
        path,
    )  # fmt: skip
    return path


def write_spikes(path: Path) -> Path:
    encoding = EncodingInfo(
        "2026-11-23T12:00:00Z", "1.0", True, TRAINING.inputs, ("none",),
        {"trial_id": ("", "number", np.array([1])), "texture": ("", "plate", ["A"])},
        SensorLayout(1, 2, ("I",)), EncoderParameters(), RANGES, "texture",
        force_matrix(), {},
    )  # fmt: skip
    with SpikeFileWriter(path, encoding) as writer:
        samples = np.arange(4, dtype=np.int32)
        writer.add(np.ones((1, 4), np.int64), samples, 1000 * samples.astype(np.int64))
    return path
