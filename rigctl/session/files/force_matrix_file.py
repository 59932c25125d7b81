"""Read and write the force matrix C as HDF5 arrays in a model or spikes file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.reading import Reading
from rigctl.errors import SessionError, WrongUse
from rigctl.session.files.analysis_file import open_analysis_file, read_inputs
from rigctl.session.files.encoder_group import read_reading
from rigctl.session.hdf5_file import Hdf5File, numbers, texts, write_array, write_texts

AXES = "texture, taxel, speed, force"
_ARRAYS = ("c", "status", "residual_hz", "evaluations")
EVALUATIONS_DOC = "encodings in the search; one of some trials counts as their share of samples"
STATUS_DOC = "-1 absent, 0 reference force, 1 converged, 2 limited to 5, 3 at a jump of the rate"


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
    if force.rate_hz is not None:
        write_array(group, "rate_hz", force.rate_hz, "Hz", "mean SA rate reached with C", AXES)


def read_force(file: Hdf5File, group: str) -> ForceMatrix:
    """Return C in a group. Raises SessionError or WrongUse if there is none or an invalid one."""
    names = ("textures", "speeds_mm_s", "forces_g", "reference_g", *_ARRAYS)
    textures, speeds, forces, reference, *arrays = (f"{group}/{name}" for name in names)
    file.check([texts(textures), numbers(speeds, 1), numbers(forces, 1), numbers(reference)])
    rate_hz = f"{group}/rate_hz"
    optional = [rate_hz] if file.has(rate_hz) else []
    file.check(numbers(path, 4) for path in [*arrays, *optional])
    c, status, residual_hz, evaluations = arrays
    force = ForceMatrix(
        file.texts(textures),
        tuple(file.array(speeds).tolist()),
        tuple(file.array(forces).tolist()),
        file.number(reference),
        file.array(c),
        file.array(status, np.int8),
        file.array(residual_hz),
        file.array(evaluations),
        file.array(rate_hz) if optional else None,
    )
    _check(force)
    return force


def _check(force: ForceMatrix) -> None:
    conditions = len(force.textures), len(force.speeds_mm_s), len(force.forces_g)
    shape = (conditions[0], force.c.shape[1], *conditions[1:])
    measured = [force.residual_hz] if force.rate_hz is None else [force.residual_hz, force.rate_hz]
    shapes = {force.status.shape, force.evaluations.shape, *(array.shape for array in measured)}
    if {force.c.shape, *shapes} != {shape} or not np.isfinite(force.c).all():
        raise WrongUse("C lacks a finite value for some texture, taxel, speed or force")
    if not all(np.isfinite(array).all() for array in measured):
        raise WrongUse("C has an SA rate that is not finite")
    if not np.isfinite([*force.speeds_mm_s, *force.forces_g]).all():
        raise WrongUse("C has a speed or a force that is not finite")


def load_force(path: Path, reading: Reading) -> tuple[ForceMatrix, tuple[dict[str, Any], ...]]:
    """Return C of a model or spikes file, and the source sessions of its search.

    ``reading``: what the encoder takes that is to use this C.

    Raises SessionError for a newer, damaged or other file and for one without C, WrongUse for a C
    of another reading.
    """
    with open_analysis_file(path, "--c takes a model or a spikes.h5") as file:
        if not file.has("c"):
            raise SessionError(
                f"{path} contains no C: name a model of a Force Scaled representation, or a "
                "spikes.h5 of sessions with several forces"
            )
        if (searched_on := read_reading(file, "encoder")) is not reading:
            raise WrongUse(
                f"{path}: its C was searched with reading = {searched_on}, this encoder takes "
                f"{reading}: use the same reading, or a C that was searched with it"
            )
        return read_force(file, "c"), read_inputs(file)
