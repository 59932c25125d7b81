"""Models, finger models, spikes, force matrices and cache entries."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.analysis.cache import Cache
from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.reading import Reading
from rigctl.finger.model_file import (
    FingerCalibration,
    FingerModel,
    load_finger_model,
    save_finger_model,
)
from rigctl.session.analysis_file import (
    EncodingInfo,
    SpikeFileWriter,
    load_force,
    load_inputs,
    load_ranges,
)
from rigctl.session.model_file import Classifier, Model, TrainingInfo, load_model, save_model
from rigctl.session.sensor_layout import SensorLayout
from tests.fuzz.kind import Kind, Place
from tests.fuzz.mutations.bytes import BYTES
from tests.fuzz.mutations.hdf5 import HDF5

FILE = "file.h5"
KEY = "ab" * 32
INPUTS = ({"path": "/data/one", "content": "0" * 64},)
UTC = "2026-11-21T12:00:00Z"
TRAINING = TrainingInfo(UTC, "0.1.0", "", 7, True, 12, (40.0, 80.0), (250.0, 500.0), INPUTS)


def force_matrix(n_taxels: int = 4) -> ForceMatrix:
    """Return a small C."""
    shape = (2, n_taxels, 2, 2)
    c = 1 + np.arange(np.prod(shape)).reshape(shape) / 100
    zeros = np.zeros(shape)
    return ForceMatrix(
        ("A", "B"), (40.0, 80.0), (250.0, 500.0), 500.0, c, zeros.astype(np.int8), zeros, zeros
    )


def ranges(n_taxels: int) -> Normalisation:
    """Return ranges of taxels."""
    low = np.arange(10, 10 + n_taxels, dtype=np.uint16)
    return Normalisation(low, low + 700, "all trials")


def build_model(folder: Path) -> None:
    """Write a small model that uses C."""
    random = np.random.default_rng(1)
    layout = FeatureLayout(3, scaled=True)
    p, k = layout.n_features(4), 3
    factor = np.tril(random.random((k, k))) + np.eye(k)
    model = Model(
        *(random.random(p), random.random((p, k)), random.random(k), factor),
        *(random.random((k, 2)), np.log([0.5, 0.5]), np.zeros(0, np.int64)),
        representation="Force Scaled",
        key="fs",
        force="texture",
        classes=("A", "B"),
        parameters=EncoderParameters(),
        normalisation=ranges(4),
        features=layout,
        c=force_matrix(),
        training=TRAINING,
    )
    save_model(model, folder / FILE)


def build_finger_model(folder: Path) -> None:
    """Write a small, calibrated model of the finger."""
    random = np.random.default_rng(2)
    n, k, trials = 3, 2, 5
    stages = tuple(
        Classifier(
            mean=random.random(n * w),
            axes=random.random((n * w, k)),
            variance=random.random(k),
            factor=np.eye(k),
            whitened_means=random.random((k, 2)),
            log_priors=np.log([0.5, 0.5]),
            dropped=np.zeros(0, np.int64),
        )
        for w in (1, 2)
    )
    calibration = FingerCalibration(
        *(random.random(2 * n), np.array([0, 1, 0, 1, 0])),
        *(random.random((2, trials, 2)), random.random((2, trials))),
    )
    model = FingerModel(
        *("Speed Scaled", ("A", "B"), EncoderParameters(), ranges(n), 100_000, "skin 1"),
        *(stages, TRAINING, calibration),
    )
    save_finger_model(model, folder / FILE)


def build_spikes(folder: Path) -> None:
    """Write the spikes of three trials."""
    sensor = SensorLayout.default(4)
    columns: dict[str, tuple[str, str, Any]] = {
        "trial_id": ("", "number", np.arange(1, 4)),
        "texture": ("", "plate", ["A", "B", "A"]),
    }
    layout = FeatureLayout(2, scaled=False)
    info = EncodingInfo(
        made_utc=UTC,
        software="rigctl 0.1.0",
        simulated=True,
        inputs=INPUTS,
        remarks=("one remark",),
        trials=columns,
        layout=sensor,
        parameters=EncoderParameters(),
        normalisation=ranges(4),
        scaled_by="texture",
        force=force_matrix(),
        layouts={"unscaled": layout},
    )
    with SpikeFileWriter(folder / FILE, info) as file:
        counts = np.ones((3, 2 * sensor.n_taxels), np.int64)
        samples = np.arange(counts.sum(), dtype=np.int32)
        file.add(counts, samples, 1000 * samples.astype(np.int64))
        windows = np.ones((*counts.shape, 2), np.int64)
        file.add_windows("unscaled", windows, np.ones((3, 2)))


def build_entry(folder: Path) -> None:
    """Write one entry of a cache."""
    Cache(folder).put(KEY, {"counts": np.arange(60).reshape(3, 20), "rates": np.ones(5)})


def read_model(folder: Path) -> object:
    """Load a model."""
    return plain(load_model(folder / FILE))


def read_finger_model(folder: Path) -> object:
    """Load a model of the finger."""
    return plain(load_finger_model(folder / FILE))


def read_force(folder: Path) -> object:
    """Load C with its sources, as ``--c`` does."""
    return plain(load_force(folder / FILE, Reading.COUNTS))


def read_ranges(folder: Path) -> object:
    """Load the ranges of the taxels, as ``--ranges`` does."""
    found = load_ranges(folder / FILE)
    return plain((found.low, found.high))


def read_sources(folder: Path) -> object:
    """Load what a file was made from."""
    return plain(load_inputs(folder / FILE))


def read_entry(folder: Path) -> object:
    """Get an entry; None if there is no whole one."""
    arrays = Cache(folder).get(KEY)
    return None if arrays is None else plain(arrays)


def plain(value: object) -> object:
    """Return a value that can be compared: arrays as digests with type and shape."""
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"{value.dtype} {value.shape} {digest}"
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    return repr(value)


HDF5_FILE = (Place(FILE, HDF5),)
ANALYSIS_KINDS = (
    Kind("model", build_model, HDF5_FILE, (read_model,)),
    Kind("finger-model", build_finger_model, HDF5_FILE, (read_finger_model,)),
    Kind("spikes", build_spikes, HDF5_FILE, (read_ranges, read_sources)),
    Kind("force-matrix", build_spikes, HDF5_FILE, (read_force, read_sources)),
    Kind("cache-entry", build_entry, (Place("*/*.npz", BYTES),), (read_entry,)),
)
