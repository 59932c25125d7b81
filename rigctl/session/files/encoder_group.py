"""Read and write encoder parameters and taxel ranges as an HDF5 group."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.session.files.analysis_file import open_analysis_file
from rigctl.session.format.annotated_arrays import read_array, read_text, write_array, write_text

ENCODER_UNITS = {
    "a": "1/ms", "b": "1/ms", "c_mv": "mV", "d": "mV/ms", "quadratic": "1/(mV ms)",
    "linear": "1/ms", "constant": "mV/ms", "threshold_mv": "mV", "start_v_mv": "mV",
    "start_u": "mV/ms", "substep_ms": "ms", "sa_gain": "mV/ms", "ra_gain": "mV",
    "ra_lowpass_hz": "Hz", "sample_rate_hz": "Hz",
}  # fmt: skip


def write_encoder(group: Any, parameters: EncoderParameters, ranges: Normalisation) -> None:
    """Write every parameter and the ranges."""
    for name, value in parameters.as_dict().items():
        doc = f"EncoderParameters.{name}"
        if isinstance(value, str):
            write_text(group, name, value, doc)
        else:
            write_array(group, name, value, ENCODER_UNITS.get(name, ""), doc)
    unit = "stored counts"
    write_array(group, "taxel_low", ranges.low, unit, "reading that becomes 0", "taxel")
    write_array(group, "taxel_high", ranges.high, unit, "reading that becomes 1", "taxel")
    write_text(group, "taxel_range_source", ranges.source, "what the ranges are from")


def read_parameters(group: Any) -> EncoderParameters:
    """Return the parameters. Raises KeyError or WrongUse for missing or invalid ones."""
    names = EncoderParameters().as_dict()
    return EncoderParameters.from_dict({name: _value(group[name]) for name in names})


def read_ranges(group: Any) -> Normalisation:
    """Return the ranges. Raises KeyError or WrongUse for missing or invalid ones."""
    low, high = (read_array(group, f"taxel_{end}", np.uint16) for end in ("low", "high"))
    return Normalisation(low, high, read_text(group, "taxel_range_source"))


def load_ranges(path: Path) -> Normalisation:
    """Return the taxel ranges of a spikes or model file. Raises SessionError for another file."""
    with open_analysis_file(path, "--ranges takes all, training or one") as file:
        ranges = read_ranges(file["encoder"])
    return Normalisation(ranges.low, ranges.high, f"those of {path}: {ranges.source}")


def _value(dataset: Any) -> Any:
    value = dataset[()]
    return value.decode() if isinstance(value, bytes) else value.item()
