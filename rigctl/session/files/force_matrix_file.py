"""Read and write the force matrix C as HDF5 arrays in a model or spikes file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.errors import SessionError
from rigctl.session.files.analysis_file import open_analysis_file, read_inputs
from rigctl.session.format.annotated_arrays import read_array, read_texts, write_array, write_texts

AXES = "texture, taxel, speed, force"
EVALUATIONS_DOC = "encodings in the search; one of some trials counts as their share of samples"
STATUS_DOC = "0 reference force, 1 converged, 2 capped, 3 at a jump of the rate"


def write_force(group: Any, force: ForceMatrix) -> None:
    """Write C with the results of its search."""
    write_texts(
        group, "textures", force.textures, "names, in the order of the first axis", "texture"
    )
    write_array(group, "speeds_mm_s", np.array(force.speeds_mm_s), "mm/s", "planned", "speed")
    write_array(group, "forces_g", np.array(force.forces_g), "g", "planned", "force")
    write_array(group, "reference_g", force.reference_g, "g", "force with the target SA rates")
    write_array(group, "c", force.c, "none", "factor on the SA current", AXES)
    write_array(group, "status", force.status, "none", STATUS_DOC, AXES)
    write_array(group, "residual_hz", force.residual_hz, "Hz", "rate reached less the target", AXES)
    write_array(group, "evaluations", force.evaluations, "none", EVALUATIONS_DOC, AXES)


def read_force(group: Any) -> ForceMatrix:
    """Return C. Raises KeyError or ValueError if the group has none or an invalid one."""
    force = ForceMatrix(
        read_texts(group, "textures"),
        tuple(read_array(group, "speeds_mm_s").tolist()),
        tuple(read_array(group, "forces_g").tolist()),
        float(group["reference_g"][()]),
        read_array(group, "c"),
        read_array(group, "status", np.int8),
        read_array(group, "residual_hz"),
        read_array(group, "evaluations"),
    )
    textures, speeds, forces = len(force.textures), len(force.speeds_mm_s), len(force.forces_g)
    shape = (textures, force.c.shape[1] if force.c.ndim == 4 else -1, speeds, forces)
    if force.c.shape != shape or not np.isfinite(force.c).all():
        raise ValueError("C lacks a finite value for some texture, taxel, speed or force")
    return force


def load_force(path: Path) -> tuple[ForceMatrix, tuple[dict[str, Any], ...]]:
    """Return C of a model or spikes file, and the source sessions of its search.

    Raises SessionError for a newer, damaged or other file and for one without C.
    """
    with open_analysis_file(path, "--c takes a model or a spikes.h5") as file:
        if "c" not in file:
            raise SessionError(
                f"{path} contains no C: name a model of a Force Scaled representation, or a "
                "spikes.h5 of sessions with several forces"
            )
        return read_force(file["c"]), read_inputs(file)
