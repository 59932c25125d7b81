"""Save and load a trained classifier as plain HDF5 arrays with units and a layout version.

``docs/reference/model.md`` shows the layout and how to classify with it without rigctl.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import shorten
from rigctl.encoder.features import FeatureLayout
from rigctl.encoder.force_gain import GAINED
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import EncoderParameters
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import (
    LAYOUT_VERSION,
    MODEL_LAYOUT,
    new_analysis_file,
    open_analysis_file,
    read_force,
    read_inputs,
    read_parameters,
    read_ranges,
    write_encoder,
    write_force,
)
from rigctl.session.hdf5_file import (
    Attributes,
    Hdf5File,
    write_array,
    write_attributes,
    write_text,
    write_texts,
)
from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]
LONGEST_WINDOW_MS = 1_000_000
C_USES = ("texture", "blind")
FORCE_DOC = "scaling of the SA current: texture or blind (C), divided, calibrated, or empty"

_FACTOR = "lower Cholesky factor of the pooled covariance, divisor n - classes"
_MEANS = "factor · whitened = class mean of the scores"
_DROPPED = "0-based components without within-class variance, which are ignored"
_HASHES = "XXH3 (64 bits, seed 0) of the bytes of each training trial's samples, ascending"
_ARRAYS = (
    ("pca/mean", "of the features", "training mean", "feature"),
    ("pca/axes", "", "unit vectors", "feature, component"),
    ("pca/variance", "squared", "divisor n - 1", "component"),
    ("lda/factor", "of the features", _FACTOR, "component, component"),
    ("lda/whitened_means", "", _MEANS, "component, class"),
    ("lda/log_priors", "", "ln of the training share", "class"),
    ("lda/dropped", "", _DROPPED, "dropped component"),
)
"""Data set, unit, meaning and axes of each array of :class:`Model`."""
Arrays = Sequence[tuple[str, str, str, str]]
INDICES = {"dropped": "component", "labels": "class"}
"""Arrays of indices, and the axis that they lead into."""


@dataclass(frozen=True, slots=True)
class TrainingInfo:
    """Source sessions and software of a model.

    ``inputs``: a mapping for each session; its ``content`` is the digest of the recording.
    ``seed`` belongs to the analysis that made the model, because training itself is not random.
    ``trial_hashes``: XXH3 (64 bits) of the bytes of each training trial's samples, by which the
    trial is known in every copy; None in files from before they were kept.
    """

    made_utc: str
    software_version: str
    software_commit: str
    seed: int
    simulated: bool
    trials: int
    speeds_mm_s: tuple[float, ...]
    forces_g: tuple[float, ...]
    inputs: tuple[dict[str, Any], ...] = ()
    trial_hashes: frozenset[int] | None = None


@dataclass(frozen=True, slots=True)
class Classifier:
    """Principal components and discriminants; all arrays are in C order.

    ``mean`` float64 (p,), ``axes`` (p, k), ``variance`` (k,), divisor n − 1: principal components.
    ``factor`` (k, k), lower Cholesky factor of the pooled within-class covariance of the scores
    (divisor n − classes); ``whitened_means`` (k, classes); ``log_priors`` (classes,); ``dropped``
    int64, 0-based components that the classifier ignores.
    """

    mean: Floats
    axes: Floats
    variance: Floats
    factor: Floats
    whitened_means: Floats
    log_priors: Floats
    dropped: NDArray[np.int64]

    @property
    def components(self) -> int:
        """Number of principal components of a prediction."""
        return int(self.axes.shape[1])


@dataclass(frozen=True, slots=True)
class Model(Classifier):
    """The classifier of one representation, with encoder and windows.

    ``force``: what scales the SA current: C of the trial's own ``texture`` or ``blind`` to it,
    which need ``c``, one of :data:`~rigctl.encoder.force_gain.GAINED`, or empty for nothing.
    """

    representation: str
    key: str
    force: str
    classes: tuple[str, ...]
    parameters: EncoderParameters
    normalisation: Normalisation
    features: FeatureLayout
    c: ForceMatrix | None
    training: TrainingInfo
    sample_rate_hz: int = SAMPLE_RATE_HZ

    @property
    def n_taxels(self) -> int:
        """Number of taxels of a sample."""
        return self.normalisation.n_taxels


def save_model(model: Model, path: Path) -> None:
    """Write a new file, complete or not at all. Raises WrongUse or DiskFault."""
    with new_analysis_file(path) as file:
        _write(file, model)


def load_model(path: Path) -> Model:
    """Return a model. Raises SessionError for a damaged, newer or other file."""
    with open_analysis_file(
        path, "choose a model, which rigctl analyse --save-model writes", MODEL_LAYOUT
    ) as file:
        return _read(file)


def _write(file: Any, model: Model) -> None:
    header: Attributes = {"layout": MODEL_LAYOUT, "layout_version": LAYOUT_VERSION}
    write_attributes(file, {**header, "simulated": int(model.training.simulated)})
    write_text(file, "representation", model.representation, "name in the paper")
    write_text(file, "key", model.key, "short name of the representation")
    write_text(file, "force", model.force, FORCE_DOC)
    write_texts(file, "classes", model.classes, "textures to choose from", "class")
    write_encoder(file.create_group("encoder"), model.parameters, model.normalisation)
    _write_features(file.create_group("features"), model.features)
    write_arrays(file, model, _ARRAYS)
    if model.c is not None:
        write_force(file.create_group("c"), model.c)
    write_training(file.create_group("training"), model.training)


def _write_features(group: Any, features: FeatureLayout) -> None:
    write_array(group, "n_windows", features.n_windows, "", "windows of a train")
    write_array(group, "window_ms", features.window_ms, "ms", "at the reference speed")
    write_array(group, "reference_mm_s", features.reference_mm_s, "mm/s", "reference speed")
    write_array(group, "speed_scaled", features.scaled, "", "1: windows of texture travelled")
    order = "SA taxel 1 … n, RA taxel 1 … n; each with its windows; SA in Hz, RA as counts"
    write_text(group, "order", order, "elements of a feature vector")


def write_training(group: Any, training: TrainingInfo) -> None:
    """Write the sources of a model."""
    write_text(group, "made_utc", training.made_utc, "wall clock, ISO 8601")
    write_text(group, "software_version", training.software_version, "of rigctl")
    write_text(group, "software_commit", training.software_commit, "of rigctl, where it is known")
    write_array(group, "seed", training.seed, "", "of the analysis that made it")
    write_array(group, "trials", training.trials, "", "number of training trials")
    write_array(group, "speeds_mm_s", np.array(training.speeds_mm_s), "mm/s", "trained", "speed")
    write_array(group, "forces_g", np.array(training.forces_g), "g", "trained", "force")
    if training.trial_hashes is not None:
        hashes = np.array(sorted(training.trial_hashes), np.uint64)
        write_array(group, "trial_hashes", hashes, "", _HASHES, "trial")
    inputs = json.dumps(training.inputs, ensure_ascii=False)
    write_text(group, "inputs", inputs, "JSON: a mapping for each session, content is its digest")


def _read(file: Hdf5File) -> Model:
    parameters = read_parameters(file, "encoder")
    model = Model(
        representation=file.text("representation"),
        key=file.text("key"),
        force=file.text("force"),
        classes=file.texts("classes"),
        parameters=parameters,
        normalisation=read_ranges(file, "encoder"),
        features=_read_features(file),
        **read_arrays(file, "", _ARRAYS),
        c=read_force(file, "c") if file.has("c") else None,
        training=read_training(file),
        sample_rate_hz=round(parameters.sample_rate_hz),
    )
    _check_shapes(model)
    return model


def _read_features(file: Hdf5File) -> FeatureLayout:
    names = ("n_windows", "speed_scaled", "window_ms")
    n_windows, scaled, window_ms = (file.integer(f"features/{name}") for name in names)
    reference_mm_s = file.number("features/reference_mm_s")
    if not (n_windows >= 1 and 1 <= window_ms <= LONGEST_WINDOW_MS and reference_mm_s > 0):
        raise WrongUse("features: the number, length and speed of windows must be above 0")
    return FeatureLayout(n_windows, bool(scaled), window_ms, reference_mm_s)


def read_training(file: Hdf5File) -> TrainingInfo:
    """Return what :func:`write_training` wrote into the group ``training``."""
    simulated = file.attributes().get("simulated")
    if simulated not in (0, 1):
        raise WrongUse(f"attribute simulated is {simulated}, not 0 or 1")
    return TrainingInfo(
        made_utc=file.text("training/made_utc"),
        software_version=file.text("training/software_version"),
        software_commit=file.text("training/software_commit"),
        seed=file.integer("training/seed"),
        simulated=bool(simulated),
        trials=file.integer("training/trials"),
        speeds_mm_s=tuple(file.array("training/speeds_mm_s", 1).tolist()),
        forces_g=tuple(file.array("training/forces_g", 1).tolist()),
        inputs=read_inputs(file),
        trial_hashes=_read_hashes(file),
    )


def _read_hashes(file: Hdf5File) -> frozenset[int] | None:
    path = "training/trial_hashes"
    if not file.has(path):
        return None
    return frozenset(file.array(path, 1, np.uint64).tolist())


def _check_shapes(model: Model) -> None:
    """Raise WrongUse if shapes do not agree or a value is not finite."""
    sizes = {
        "feature": model.features.n_features(model.n_taxels),
        "component": model.components,
        "class": len(model.classes),
        "dropped component": len(model.dropped),
    }
    check_arrays(model, _ARRAYS, sizes)
    if model.force not in ("", *C_USES, *GAINED):
        raise WrongUse(f"force is {shorten(model.force)}, which this version does not know")
    if model.force in C_USES and model.c is None:
        raise WrongUse("its representation is scaled to force, but there is no C")


def write_arrays(group: Any, values: object, arrays: Arrays) -> None:
    """Write each array of an object: data set, unit, meaning and axes."""
    for path, unit, doc, axes in arrays:
        write_array(group, path, getattr(values, _field(path)), unit, doc, axes)


def read_arrays(file: Hdf5File, group: str, arrays: Arrays) -> dict[str, NDArray[Any]]:
    """Return the arrays of a group by name: indices are int64, all others float64."""
    return {
        _field(path): file.array(
            f"{group}/{path}".lstrip("/"),
            axes.count(",") + 1,
            np.int64 if _field(path) in INDICES else np.float64,
        )
        for path, *_, axes in arrays
    }


def check_arrays(values: object, arrays: Arrays, sizes: Mapping[str, int]) -> None:
    """Raise WrongUse if shapes do not agree, a value is not finite, or an index leads outside."""
    for path, _, _, axes in arrays:
        name = _field(path)
        array, shape = getattr(values, name), tuple(sizes[axis] for axis in axes.split(", "))
        if array.shape != shape or not np.isfinite(array).all():
            raise WrongUse(f"{name} should be {shape} finite numbers and is {array.shape}")
        length = sizes[INDICES[name]] if name in INDICES else 0
        if name in INDICES and not ((array >= 0) & (array < length)).all():
            raise WrongUse(f"{name} should be from 0 to {length - 1}")


def _field(path: str) -> str:
    return path.rpartition("/")[2]
