"""Write a trained PCA and LDA as a C++ header for the finger board's classifier."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.wire.finger.messages import N_TAXELS

N_WINDOWS = 20
N_FEATURES = N_TAXELS * N_WINDOWS
MAX_CLASSES, MAX_COMPONENTS = 8, 96

_Floats = NDArray[np.float64]


def model_header(
    mean: _Floats, axes: _Floats, coefficients: _Floats, intercepts: _Floats, classes: Sequence[str]
) -> str:
    """Return the header of a model: ``-DFINGER_MODEL='"file.h"'`` builds an image with it.

    ``mean`` (180,) in spikes/s, ``axes`` (180, k), ``coefficients`` (classes, k), ``intercepts``
    (classes,), float64 each. Raises WrongUse for a model that the board has no room for.
    """
    n_classes, components = coefficients.shape
    if axes.shape != (N_FEATURES, components) or mean.shape != (N_FEATURES,):
        raise WrongUse(f"the board's classifier takes {N_FEATURES} features: train it on a finger")
    if n_classes > MAX_CLASSES or components > MAX_COMPONENTS:
        raise WrongUse(
            f"the board's classifier has room for {MAX_CLASSES} classes and {MAX_COMPONENTS} "
            f"components, not {n_classes} and {components}"
        )
    arrays = {"MEAN": mean, "AXES": axes, "COEFFICIENTS": coefficients, "INTERCEPTS": intercepts}
    definitions = "\n".join(_array(name, values) for name, values in arrays.items())
    return (
        f"// Classes: {', '.join(classes)}. Hexadecimal floating point: every bit of the model.\n"
        f'#include "classifier.h"\n\nnamespace finger_model {{\n\n{definitions}\n'
        "}  // namespace finger_model\n\n"
        f"const ClassifierModel FINGER_CLASSIFIER = {{{n_classes}, {components}, "
        "finger_model::MEAN, finger_model::AXES,\n"
        "    finger_model::COEFFICIENTS, finger_model::INTERCEPTS};\n"
    )


def _array(name: str, values: _Floats) -> str:
    numbers = ",\n    ".join(float(value).hex() for value in values.ravel())
    return f"const double {name}[{values.size}] = {{\n    {numbers},\n}};\n"
