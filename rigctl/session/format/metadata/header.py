"""Metadata of a session from before its first sample: stored as attributes of every part."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, PRESETS, EncoderParameters
from rigctl.encoding.reading import FULL_SCALE, Reading
from rigctl.session.format.layout import DRUM_EXPERIMENT
from rigctl.session.format.metadata.header_values import parse_header_values
from rigctl.session.format.metadata.sensor_layout import ATTRIBUTE, SensorLayout
from rigctl.session.hdf5_file import Attributes
from rigctl.values import N_TAXELS, SAMPLE_RATE_HZ, BoardIdentity

IMPORTED = "import"
"""``rig`` of a session that was imported from other recordings."""
CUT_BY_WIRE, CUT_BY_CLOCK = "sync line", "drum clock"
"""``cut_by``: the signal that marks the first sample of a trial."""
ADC_COUNTS = f"ADC counts, 0–{FULL_SCALE}"
_FINGER_ONLY = ("experiment", "reference_um_per_s", "stages", "tracker")


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """Operator, rig, boards, software, plan and sample format of a session.

    ``start_utc`` is an ISO 8601 time stamp from the command line, ``start_loop_s`` the loop time
    at that instant. ``taxel_low`` and ``taxel_high`` are the calibrated range of each taxel in
    stored counts, empty without calibration. ``encoder_reading``: what the live encoder took of the
    samples, a :class:`~rigctl.encoding.reading.Reading`; older parts have counts. ``wiring`` is the
    reading of the taxel wire in each column of the samples;
    :mod:`rigctl.session.format.metadata.wiring` explains an empty one.
    ``sensor_layout`` has rows, columns and layers of the sensor; None in older parts.
    ``sample_unit`` is the unit of a reading, ``highest_reading`` its upper limit. ``cut_by`` is
    the signal that marks the first sample of a trial, empty if unknown. ``simulation`` holds what
    repeats a simulated bench (seed, slice length, parameters) and is empty for a real one.

    The moving finger also has ``experiment``, the reference speed of scaled time, the planned
    ``stages`` and the ``tracker`` (name and plate frame); parts of the drum lack these attributes.
    ``taxel_low`` and ``taxel_high`` are then the ranges that the board uses in the part.
    """

    plan_hash: str
    seed: int
    trials_planned: int
    rig: str
    simulated: bool
    start_utc: str
    start_loop_s: float = 0.0
    protocol: str = ""
    boards: tuple[BoardIdentity, ...] = ()
    operator: str = ""
    sensor: str = ""
    software_version: str = ""
    software_commit: str = ""
    encoder_preset: str = ""
    encoder_reading: str = Reading.COUNTS
    n_taxels: int = N_TAXELS
    sample_rate_hz: int = SAMPLE_RATE_HZ
    sample_unit: str = ADC_COUNTS
    highest_reading: int = FULL_SCALE
    taxel_low: tuple[int, ...] = ()
    taxel_high: tuple[int, ...] = ()
    wiring: tuple[int, ...] = ()
    sensor_layout: SensorLayout | None = None
    cut_by: str = ""
    simulation: dict[str, Any] = field(default_factory=dict)
    experiment: str = DRUM_EXPERIMENT
    reference_um_per_s: int = 0
    stages: tuple[str, ...] = ()
    tracker: dict[str, Any] = field(default_factory=dict)

    @property
    def encoder_parameters(self) -> EncoderParameters:
        """Parameters of the live encoder; those of an unknown preset are the default's."""
        known = PRESETS.get(self.encoder_preset, DEFAULT)
        return replace(known, reading=Reading(self.encoder_reading))

    @property
    def calibrated_ranges(self) -> Normalisation | None:
        """Calibrated range of each taxel for the live encoder; None without one.

        A calibration is in counts, so there is none for another reading.
        """
        is_calibrated = self.taxel_low and self.taxel_high
        if not is_calibrated or self.encoder_reading != Reading.COUNTS:
            return None
        low, high = (np.array(side, np.uint16) for side in (self.taxel_low, self.taxel_high))
        return Normalisation(low, high, "calibration of the session")

    def to_attributes(self) -> Attributes:
        """Return the attributes of a part's root; sequences and mappings become JSON."""
        values = {
            name: json.dumps(value) if isinstance(value, tuple | dict) else value
            for name, value in asdict(self).items()
            if name not in _FINGER_ONLY or self.experiment != DRUM_EXPERIMENT
        }
        if self.sensor_layout is None:
            del values[ATTRIBUTE]
        return {**values, "simulated": int(self.simulated)}

    @classmethod
    def from_attributes(cls, attributes: Mapping[str, Any], path: Path) -> SessionHeader:
        """Return the inverse of :meth:`to_attributes`; ignore unknown attributes.

        ``path``: the part. Raises SessionError for missing and for wrong ones.
        """
        values = parse_header_values(attributes, path)
        return cls(**{**values, "simulated": bool(values["simulated"])})
