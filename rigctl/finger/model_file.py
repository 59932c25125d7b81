"""Save and load a classifier of the moving finger as plain HDF5 arrays.

It holds a PCA and LDA for each number of windows from 1 to 20, so that the answer can grow with the
scan, and, once calibrated, the new session's mean and what its trials say of the answers' errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import (
    FINGER_MODEL_LAYOUT,
    LAYOUT_VERSION,
    new_analysis_file,
    open_analysis_file,
    read_parameters,
    read_ranges,
    write_encoder,
)
from rigctl.session.hdf5_file import (
    Attributes,
    Hdf5File,
    write_array,
    write_attributes,
    write_text,
    write_texts,
)
from rigctl.session.model_file import (
    Classifier,
    TrainingInfo,
    check_arrays,
    read_arrays,
    read_training,
    write_arrays,
    write_training,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
HIGHEST_REFERENCE_UM_PER_S = 10_000_000

_WINDOW_ARRAYS = (
    ("mean", "Hz", "training mean of the features, taxel after taxel", "feature"),
    ("axes", "", "principal components", "feature, component"),
    ("variance", "Hz²", "of the components, divisor n - 1", "component"),
    ("factor", "Hz", "lower Cholesky factor, divisor n - classes", "component, component"),
    ("whitened_means", "", "factor · whitened = class mean", "component, class"),
    ("log_priors", "", "ln of the training share", "class"),
    ("dropped", "", "0-based components that are ignored", "dropped component"),
)
_CALIBRATION_ARRAYS = (
    ("mean", "Hz", "mean features of the calibration, taxel after taxel", "feature"),
    ("labels", "", "0-based texture of each trial", "trial"),
    ("logs", "", "log posteriors, centred by the other trials", "windows, trial, class"),
    ("distances", "", "squared distance from the nearest class", "windows, trial"),
)


@dataclass(frozen=True, slots=True)
class FingerCalibration:
    """What the calibration trials of a session say.

    ``mean``: of their feature vectors, float64 (p,), which replaces the training mean. ``labels``:
    int64 (n,). ``logs``: log posteriors of each trial after 1 … k windows, float64
    (windows, n, classes), where the mean is that of the other trials. ``distances``: squared
    distance to the nearest class in units of the spread within it, float64 (windows, n).
    """

    mean: Floats
    labels: Integers
    logs: Floats
    distances: Floats


@dataclass(frozen=True, slots=True)
class FingerModel:
    """Encoder, scaled time and classifiers of one representation.

    ``representation``: its name in the paper. ``stages``: the classifier of the first window, of
    the first two, … of all. ``sensor``: as the session's header names it.
    """

    representation: str
    textures: tuple[str, ...]
    parameters: EncoderParameters
    normalisation: Normalisation
    reference_um_per_s: int
    sensor: str
    stages: tuple[Classifier, ...]
    training: TrainingInfo
    calibration: FingerCalibration | None = None

    @property
    def n_taxels(self) -> int:
        """Number of taxels of the finger."""
        return self.normalisation.n_taxels

    @property
    def n_windows(self) -> int:
        """Number of windows of a whole scan."""
        return len(self.stages)

    @property
    def mean(self) -> Floats:
        """Mean of the features of a whole scan, float64 (p,): the calibration's if there is one."""
        return self.stages[-1].mean if self.calibration is None else self.calibration.mean


def save_finger_model(model: FingerModel, path: Path) -> None:
    """Write a new file, complete or not at all. Raises WrongUse or DiskFault."""
    with new_analysis_file(path) as file:
        _write(file, model)


def load_finger_model(path: Path) -> FingerModel:
    """Return a model. Raises SessionError for a damaged, newer or other file."""
    hint = "give a file that rigctl realtime train or calibrate made"
    with open_analysis_file(path, hint, FINGER_MODEL_LAYOUT) as file:
        return _read(file)


def _write(file: Any, model: FingerModel) -> None:
    header: Attributes = {"layout": FINGER_MODEL_LAYOUT, "layout_version": LAYOUT_VERSION}
    write_attributes(file, {**header, "simulated": int(model.training.simulated)})
    write_text(file, "representation", model.representation, "name in the paper")
    write_texts(file, "textures", model.textures, "textures to choose from", "class")
    write_text(file, "sensor", model.sensor, "sensor of the training session")
    doc = "reference speed of scaled time"
    write_array(file, "reference_um_per_s", model.reference_um_per_s, "µm/s", doc)
    write_encoder(file.create_group("encoder"), model.parameters, model.normalisation)
    for number, stage in enumerate(model.stages, start=1):
        write_arrays(file.create_group(_stage(number)), stage, _WINDOW_ARRAYS)
    if model.calibration is not None:
        group = file.create_group("calibration")
        write_arrays(group, model.calibration, _CALIBRATION_ARRAYS)
    write_training(file.create_group("training"), model.training)


def _read(file: Hdf5File) -> FingerModel:
    model = FingerModel(
        representation=file.text("representation"),
        textures=file.texts("textures"),
        parameters=read_parameters(file, "encoder"),
        normalisation=read_ranges(file, "encoder"),
        reference_um_per_s=file.integer("reference_um_per_s"),
        sensor=file.text("sensor"),
        stages=_read_stages(file),
        training=read_training(file),
        calibration=FingerCalibration(**read_arrays(file, "calibration", _CALIBRATION_ARRAYS))
        if file.has("calibration")
        else None,
    )
    _check_shapes(model)
    return model


def _read_stages(file: Hdf5File) -> tuple[Classifier, ...]:
    numbers = range(1, len(file.members("windows")) + 1)
    arrays = (read_arrays(file, _stage(number), _WINDOW_ARRAYS) for number in numbers)
    return tuple(Classifier(**each) for each in arrays)


def _check_shapes(model: FingerModel) -> None:
    """Raise WrongUse if shapes do not agree or a value is not finite."""
    if not model.stages:
        raise WrongUse("it has no classifiers")
    if not 1 <= model.reference_um_per_s <= HIGHEST_REFERENCE_UM_PER_S:
        raise WrongUse(f"reference_um_per_s is {model.reference_um_per_s}")
    for number, stage in enumerate(model.stages, start=1):
        sizes = {
            "feature": number * model.n_taxels,
            "component": stage.components,
            "class": len(model.textures),
            "dropped component": len(stage.dropped),
        }
        check_arrays(stage, _WINDOW_ARRAYS, sizes)
    if model.calibration is not None:
        sizes = {
            "feature": model.n_windows * model.n_taxels,
            "trial": len(model.calibration.labels),
            "windows": model.n_windows,
            "class": len(model.textures),
        }
        check_arrays(model.calibration, _CALIBRATION_ARRAYS, sizes)


def _stage(number: int) -> str:
    return f"windows/{number:02}"
