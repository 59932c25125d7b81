"""Read and write encoder parameters and taxel ranges as an HDF5 group."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.config.rig_config import MAX_TAXELS
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.encoding.reading import Reading
from rigctl.errors import WrongUse
from rigctl.session.files.analysis_file import open_analysis_file
from rigctl.session.hdf5_file import Hdf5File, numbers, text, write_array, write_text

HIGHEST_RATE_HZ = 1e6
ENCODER_UNITS = {
    "a": "1/ms", "b": "1/ms", "c_mv": "mV", "d": "mV/ms", "quadratic": "1/(mV ms)",
    "linear": "1/ms", "constant": "mV/ms", "threshold_mv": "mV", "start_v_mv": "mV",
    "start_u": "mV/ms", "substep_ms": "ms", "sa_gain": "mV/ms", "ra_gain": "mV",
    "ra_lowpass_hz": "Hz", "sample_rate_hz": "Hz",
}  # fmt: skip


LATER_PARAMETERS = (("ra_filter", "ra_order", "ra_derivative"), ("reading",))
"""Parameters that files of older versions lack; those were encoded with the default."""


def write_encoder(group: Any, parameters: EncoderParameters, ranges: Normalisation) -> None:
    """Write every parameter and the ranges."""
    for name, value in parameters.as_dict().items():
        doc = f"EncoderParameters.{name}"
        if isinstance(value, str):
            write_text(group, name, value, doc)
        else:
            write_array(group, name, value, ENCODER_UNITS.get(name, ""), doc)
    unit = ranges.reading.unit
    write_array(group, "taxel_low", ranges.low, unit, "reading that becomes 0", "taxel")
    write_array(group, "taxel_high", ranges.high, unit, "reading that becomes 1", "taxel")
    write_text(group, "taxel_range_source", ranges.source, "what the ranges are from")


def read_parameters(file: Hdf5File, group: str) -> EncoderParameters:
    """Return the parameters in a group. Raises SessionError or WrongUse for invalid ones."""
    defaults = EncoderParameters().as_dict()
    for names in LATER_PARAMETERS:
        if not any(file.has(f"{group}/{name}") for name in names):
            defaults = {k: v for k, v in defaults.items() if k not in names}
    paths = {name: f"{group}/{name}" for name in defaults}
    file.check(
        text(paths[name]) if isinstance(default, str) else numbers(paths[name])
        for name, default in defaults.items()
    )
    values = {name: _value(file, paths[name], default) for name, default in defaults.items()}
    parameters = EncoderParameters.from_dict(values)
    if parameters.sample_rate_hz > HIGHEST_RATE_HZ:
        raise WrongUse(f"encoder parameter sample_rate_hz is {parameters.sample_rate_hz:g}")
    return parameters


def read_ranges(file: Hdf5File, group: str) -> Normalisation:
    """Return the taxel ranges in a group. Raises SessionError or WrongUse for invalid ones."""
    low, high, source = (
        f"{group}/{name}" for name in ("taxel_low", "taxel_high", "taxel_range_source")
    )
    file.check([numbers(low, 1), numbers(high, 1), text(source)])
    if not 1 <= file.shape(low)[0] <= MAX_TAXELS:
        raise WrongUse(f"{low} has {file.shape(low)[0]} taxels")
    limits = file.array(low, np.uint16), file.array(high, np.uint16)
    return Normalisation(*limits, file.text(source), read_reading(file, group))


def read_reading(file: Hdf5File, group: str) -> Reading:
    """Return the reading that ranges and neurons in a group take; older files have counts."""
    path = f"{group}/reading"
    if not file.has(path):
        return Reading.COUNTS
    file.check([text(path)])
    if file.text(path) not in list(Reading):
        raise WrongUse(f"{path} is {file.text(path)!r}, not one of {', '.join(Reading)}")
    return Reading(file.text(path))


def load_ranges(path: Path) -> Normalisation:
    """Return the taxel ranges of a spikes or model file. Raises SessionError for another file."""
    with open_analysis_file(path, "--ranges takes all, training or one") as file:
        ranges = read_ranges(file, "encoder")
    return replace(ranges, source=f"those of {path}: {ranges.source}")


def _value(file: Hdf5File, path: str, default: Any) -> str | float | int | bool:
    """Return a parameter of the type of its default."""
    if isinstance(default, str):
        return file.text(path)
    if isinstance(default, bool):
        return bool(file.integer(path))
    return file.integer(path) if isinstance(default, int) else file.number(path)
