"""A model in a file: plain HDF5 arrays with units and a layout version, and no program inside.

``docs/reference/model.md`` shows the layout and how to answer with it without rigctl.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.encoding.features import FeatureLayout
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.session.files.encoder_group import put_encoder, take_parameters, take_ranges
from rigctl.session.files.force_matrix_file import put_force, take_force
from rigctl.session.files.model import Model, TrainingInfo
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import (
    put_array,
    put_text,
    put_texts,
    take_array,
    take_text,
    take_texts,
)
from rigctl.session.read.folder import attributes

LAYOUT = "rigctl-model"
LAYOUT_VERSION = 1
PARTIAL = "{name}.partial"


def check_new(path: Path) -> None:
    """Raise WrongUse where a file is there already, or its folder is not."""
    if path.exists():
        raise WrongUse(f"{path} is there already: name another file, or remove it")
    if not path.parent.is_dir():
        raise WrongUse(f"{path.parent} is no folder: make it, or name another file")


def save_model(model: Model, path: Path) -> None:
    """Write a new file; it appears whole or not at all. Raises WrongUse and DiskFault."""
    check_new(path)
    partial = path.with_name(PARTIAL.format(name=path.name))
    try:
        with h5py.File(partial, "w", libver=layout.LIBVER) as file:
            _write(file, model)
        partial.rename(path)
    except OSError as error:
        raise DiskFault(f"{path} cannot be written ({error}): choose another place") from error
    finally:
        partial.unlink(missing_ok=True)


def load_model(path: Path) -> Model:
    """Read a model. Raises SessionError for what is none, is damaged, or is of a newer layout."""
    with _opened(path) as file:
        try:
            return _read(file)
        except (KeyError, ValueError, OSError, WrongUse, IndexError) as error:
            raise SessionError(f"{path} is damaged, it lacks what a model has: {error}") from error


def _opened(path: Path) -> Any:
    try:
        file = h5py.File(path, "r")
    except FileNotFoundError:
        raise SessionError(f"there is no file {path}: give one that --save-model made") from None
    except OSError as error:
        raise SessionError(
            f"{path} is no model, or is damaged: HDF5 cannot open it ({error})"
        ) from error
    found = attributes(file)
    if found.get("layout") != LAYOUT:
        file.close()
        raise SessionError(f"{path} is an HDF5 file, but no rigctl model")
    version = found.get("layout_version")
    if version != LAYOUT_VERSION:
        file.close()
        raise SessionError(
            f"{path} has model layout version {version}, this program reads {LAYOUT_VERSION}: "
            "use the rigctl that made it, or train it again"
        )
    return file


def _write(file: Any, model: Model) -> None:
    simulated = int(model.training.simulated)
    head: dict[str, str | int | float] = {
        "layout": LAYOUT,
        "layout_version": LAYOUT_VERSION,
        "simulated": simulated,
    }
    layout.describe(file, head)
    put_text(file, "representation", model.representation, "the paper's name of it")
    put_text(file, "key", model.key, "the same as a short word")
    put_text(file, "force", model.force, "C by the trial's own texture, blind to it, or none: ''")
    put_texts(file, "classes", model.classes, "what is told apart", "class")
    put_encoder(file.create_group("encoder"), model.parameters, model.normalisation)
    _write_features(file.create_group("features"), model.features)
    _write_pca(file.create_group("pca"), model)
    _write_lda(file.create_group("lda"), model)
    if model.c is not None:
        put_force(file.create_group("c"), model.c)
    _write_training(file.create_group("training"), model.training)


def _write_features(group: Any, features: FeatureLayout) -> None:
    put_array(group, "n_windows", features.n_windows, "", "windows of a train")
    put_array(group, "window_ms", features.window_ms, "ms", "at the reference speed")
    put_array(group, "reference_mm_s", features.reference_mm_s, "mm/s", "reference speed")
    put_array(group, "speed_scaled", features.scaled, "", "1: windows of texture travelled")
    order = "SA taxel 1 … n, RA taxel 1 … n; each with its windows; SA in Hz, RA as counts"
    put_text(group, "order", order, "what a feature vector holds")


def _write_pca(group: Any, model: Model) -> None:
    put_array(group, "mean", model.mean, "of the features", "training mean", "feature")
    put_array(group, "axes", model.axes, "", "unit vectors", "feature, component")
    put_array(group, "variance", model.variance, "squared", "divisor n - 1", "component")


def _write_lda(group: Any, model: Model) -> None:
    axes = "component, component"
    doc = "lower Cholesky factor of the pooled covariance, divisor n - classes"
    put_array(group, "factor", model.factor, "of the features", doc, axes)
    doc = "factor · whitened = class mean of the scores"
    put_array(group, "whitened_means", model.whitened_means, "", doc, "component, class")
    put_array(group, "log_priors", model.log_priors, "", "ln of the training share", "class")
    doc = "components from 0 without within-class variance: they take no part"
    put_array(group, "dropped", model.dropped, "", doc, "dropped component")


def _write_training(group: Any, training: TrainingInfo) -> None:
    put_text(group, "made_utc", training.made_utc, "wall clock, ISO 8601")
    put_text(group, "software_version", training.software_version, "of rigctl")
    put_text(group, "software_commit", training.software_commit, "of rigctl, where it is known")
    put_array(group, "seed", training.seed, "", "of the analysis that made it")
    put_array(group, "trials", training.trials, "", "that were learnt from")
    put_array(group, "speeds_mm_s", np.array(training.speeds_mm_s), "mm/s", "learnt", "speed")
    put_array(group, "forces_g", np.array(training.forces_g), "g", "learnt", "force")
    inputs = json.dumps(training.inputs, ensure_ascii=False)
    put_text(group, "inputs", inputs, "JSON: a mapping for each session, content is its digest")


def _read(file: Any) -> Model:
    pca, lda = file["pca"], file["lda"]
    parameters = take_parameters(file["encoder"])
    model = Model(
        representation=take_text(file, "representation"),
        key=take_text(file, "key"),
        force=take_text(file, "force"),
        classes=take_texts(file, "classes"),
        parameters=parameters,
        normalisation=take_ranges(file["encoder"]),
        features=_features_of(file["features"]),
        mean=take_array(pca, "mean"),
        axes=take_array(pca, "axes"),
        variance=take_array(pca, "variance"),
        factor=take_array(lda, "factor"),
        whitened_means=take_array(lda, "whitened_means"),
        log_priors=take_array(lda, "log_priors"),
        dropped=take_array(lda, "dropped", np.int64),
        c=take_force(file["c"]) if "c" in file else None,
        training=_training_of(file["training"], bool(file.attrs["simulated"])),
        sample_rate_hz=round(parameters.sample_rate_hz),
    )
    _check_shapes(model)
    return model


def _features_of(group: Any) -> FeatureLayout:
    return FeatureLayout(
        int(group["n_windows"][()]),
        scaled=bool(group["speed_scaled"][()]),
        window_ms=int(group["window_ms"][()]),
        reference_mm_s=float(group["reference_mm_s"][()]),
    )


def _training_of(group: Any, simulated: bool) -> TrainingInfo:
    return TrainingInfo(
        made_utc=take_text(group, "made_utc"),
        software_version=take_text(group, "software_version"),
        software_commit=take_text(group, "software_commit"),
        seed=int(group["seed"][()]),
        simulated=simulated,
        trials=int(group["trials"][()]),
        speeds_mm_s=tuple(take_array(group, "speeds_mm_s").tolist()),
        forces_g=tuple(take_array(group, "forces_g").tolist()),
        inputs=tuple(json.loads(take_text(group, "inputs"))),
    )


def _check_shapes(model: Model) -> None:
    """Raise ValueError where the arrays do not belong together or hold no numbers."""
    p, k, n = model.features.width(model.n_taxels), model.components, len(model.classes)
    shapes = {
        "mean": (p,),
        "axes": (p, k),
        "factor": (k, k),
        "whitened_means": (k, n),
        "log_priors": (n,),
    }
    for name, shape in shapes.items():
        array = getattr(model, name)
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"{name} should be {shape} finite numbers and is {array.shape}")
    if model.force and model.c is None:
        raise ValueError("its representation is scaled to force, but there is no C")
