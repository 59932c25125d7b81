"""The force matrix C as HDF5 arrays: a group of a model file or of an encoded session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.errors import SessionError, WrongUse
from rigctl.session.files.source_sessions import HOLDERS, take_inputs
from rigctl.session.format.annotated_arrays import put_array, put_texts, take_array, take_texts
from rigctl.session.read.folder import attributes

LAYOUT_VERSION = 1

AXES = "texture, taxel, speed, force"
EVALUATIONS_DOC = "encodings that it took, those of some trials by their share of the samples"
STATUS_DOC = "0 reference force, 1 converged, 2 capped, 3 at a jump of the rate"


def put_force(group: Any, force: ForceMatrix) -> None:
    """Store C with how it was found."""
    put_texts(group, "textures", force.textures, "names, in the order of the first axis", "texture")
    put_array(group, "speeds_mm_s", np.array(force.speeds_mm_s), "mm/s", "planned", "speed")
    put_array(group, "forces_g", np.array(force.forces_g), "g", "planned", "force")
    put_array(
        group,
        "reference_g",
        np.float64(force.reference_g),
        "g",
        "force whose SA rates are aimed at",
    )
    put_array(group, "c", force.c, "none", "factor on the SA current", AXES)
    put_array(group, "status", force.status, "none", STATUS_DOC, AXES)
    put_array(group, "residual_hz", force.residual_hz, "Hz", "rate reached less the target", AXES)
    put_array(group, "evaluations", force.evaluations, "none", EVALUATIONS_DOC, AXES)


def take_force(group: Any) -> ForceMatrix:
    """C as it was stored. Raises KeyError or ValueError where the group does not hold it."""
    force = ForceMatrix(
        take_texts(group, "textures"),
        tuple(take_array(group, "speeds_mm_s").tolist()),
        tuple(take_array(group, "forces_g").tolist()),
        float(group["reference_g"][()]),
        take_array(group, "c"),
        take_array(group, "status", np.int8),
        take_array(group, "residual_hz"),
        take_array(group, "evaluations"),
    )
    textures, speeds, forces = len(force.textures), len(force.speeds_mm_s), len(force.forces_g)
    shape = (textures, force.c.shape[1] if force.c.ndim == 4 else -1, speeds, forces)
    if force.c.shape != shape or not np.isfinite(force.c).all():
        raise ValueError("C has not a finite value for each texture, taxel, speed and force")
    return force


def read_force(path: Path) -> tuple[ForceMatrix, tuple[dict[str, Any], ...]]:
    """C of a model or of a file of spikes, and the sessions that it was searched on.

    Raises SessionError for another file, a newer or a damaged one, WrongUse where it has no C.
    """
    try:
        with h5py.File(path, "r") as file:
            found = attributes(file)
            if found.get("layout") not in HOLDERS:
                raise SessionError(f"{path} is no model and no spikes.h5: --c takes one of these")
            if found.get("layout_version") != LAYOUT_VERSION:
                raise SessionError(
                    f"{path} has layout version {found.get('layout_version')}, this program reads "
                    f"{LAYOUT_VERSION}: use the rigctl that made it, or make it again"
                )
            if "c" not in file:
                raise WrongUse(
                    f"{path} holds no C: name a model of a Force Scaled representation, or a "
                    "spikes.h5 of sessions with several forces"
                )
            return take_force(file["c"]), take_inputs(file)
    except FileNotFoundError:
        raise SessionError(f"there is no file {path}: --c takes a model or a spikes.h5") from None
    except (OSError, KeyError, ValueError) as error:
        raise SessionError(f"{path} holds no C, or is damaged: {error}") from error
