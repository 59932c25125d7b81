"""What a session says before its first sample: header, sensor and wiring, attributes of every part.

The columns of the samples are the places of the sensor: layer by layer, in each layer row by row.
If two wirings differ, taxel 4 of one session is not taxel 4 of the other, so the program never
combines the two.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from rigctl.config.rig_config import MAX_TAXELS, PAPER_ARRAY
from rigctl.config.toml_reader import TomlText
from rigctl.encoder.force_gain import ForceGain, ForceScaling
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, PRESETS, EncoderParameters
from rigctl.encoder.reading import FULL_SCALE, Reading
from rigctl.errors import SessionError
from rigctl.experiments import DRUM_EXPERIMENT
from rigctl.session.hdf5_file import Attributes, damage, describe, parse_json
from rigctl.session.sensor_layout import ATTRIBUTE, PAPER_SENSOR, SensorLayout
from rigctl.session.sensor_passport import gain_source, read_passport
from rigctl.values import SAMPLE_RATE_HZ, BoardIdentity, PluginUse

INT32 = 1 << 31
JSON_ATTRIBUTES: Mapping[str, type[Any]] = {
    "boards": list,
    "stages": list,
    "taxel_low": list,
    "taxel_high": list,
    "wiring": list,
    "sensor_layout": dict,
    "simulation": dict,
    "tracker": dict,
    "passport": dict,
    "own": dict,
    "plugins": list,
}
"""Attributes that hold JSON, and what it must be."""
Count = Annotated[int, Meta(ge=0, le=INT32)]
TaxelCount = Annotated[int, Meta(ge=1, le=MAX_TAXELS)]
RateHz = Annotated[int, Meta(ge=1, le=1_000_000)]
Counts = tuple[Annotated[int, Meta(ge=0, le=65_535)], ...]
Wiring = tuple[Annotated[int, Meta(ge=0, lt=MAX_TAXELS)], ...]
ReadingName = Annotated[str, Meta(pattern=f"^({'|'.join(Reading)})$")]
ScalingName = Annotated[str, Meta(pattern=f"^({'|'.join(ForceScaling)})$")]
IMPORTED = "import"
"""``rig`` of a session that was imported from other recordings."""
CUT_BY_WIRE, CUT_BY_CLOCK = "sync line", "drum clock"
"""``cut_by``: the signal that marks the first sample of a trial."""
ADC_COUNTS = f"ADC counts, 0–{FULL_SCALE}"
_FINGER_ONLY = ("experiment", "reference_um_per_s", "stages", "tracker")


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """People, rig, boards, software, plan and sample format of a session.

    ``start_utc`` is an ISO 8601 time stamp from the command line, ``start_loop_s`` the loop time
    at that instant. ``taxel_low`` and ``taxel_high`` are the calibrated range of each taxel in
    stored counts, empty without calibration. ``encoder_reading``: what the live encoder took of the
    samples, a :class:`~rigctl.encoder.reading.Reading`; older parts have counts.
    ``encoder_scaling``: of its SA current, a :class:`~rigctl.encoder.force_gain.ForceScaling`.
    ``wiring`` is the
    reading of the taxel wire in each column of the samples;
    :mod:`rigctl.session.header` explains an empty one.
    ``sensor_layout`` has rows, columns and layers of the sensor; None in older parts.
    ``sample_unit`` is the unit of a reading, ``highest_reading`` its upper limit. ``cut_by`` is
    the signal that marks the first sample of a trial, empty if unknown. ``simulation`` holds what
    repeats a simulated bench (seed, slice length, parameters) and is empty for a real one.
    ``own``: what people said of a lab's own fields, by their names; older parts lack it.
    ``passport``: values of :class:`~rigctl.session.sensor_passport.SensorPassport`, empty without
    one. ``plugins``: what other packages did in it.

    The moving finger also has ``experiment``, the reference speed of scaled time, the planned
    ``stages`` and the ``tracker`` (name and plate frame); parts of the drum lack these attributes.
    ``taxel_low`` and ``taxel_high`` are then the ranges that the board uses in the part.
    """

    plan_hash: str
    seed: int
    trials_planned: Count
    rig: str
    simulated: bool
    start_utc: str
    start_loop_s: float = 0.0
    protocol: str = ""
    boards: tuple[BoardIdentity, ...] = ()
    operator: str = ""
    sensor: str = ""
    plate_lot: str = ""
    project: str = ""
    remarks: str = ""
    own: dict[str, str] = field(default_factory=dict)
    software_version: str = ""
    software_commit: str = ""
    encoder_preset: str = ""
    encoder_reading: ReadingName = Reading.COUNTS
    encoder_scaling: ScalingName = ForceScaling.NONE
    n_taxels: TaxelCount = PAPER_SENSOR.n_taxels
    sample_rate_hz: RateHz = SAMPLE_RATE_HZ
    sample_unit: str = ADC_COUNTS
    highest_reading: Annotated[int, Meta(ge=1, le=65_535)] = FULL_SCALE
    taxel_low: Counts = ()
    taxel_high: Counts = ()
    wiring: Wiring = ()
    sensor_layout: SensorLayout | None = None
    cut_by: str = ""
    simulation: dict[str, Any] = field(default_factory=dict)
    passport: dict[str, Any] = field(default_factory=dict)
    plugins: tuple[PluginUse, ...] = ()
    experiment: str = DRUM_EXPERIMENT
    reference_um_per_s: Count = 0
    stages: tuple[str, ...] = ()
    tracker: dict[str, Any] = field(default_factory=dict)

    @property
    def encoder_parameters(self) -> EncoderParameters:
        """Parameters of the live encoder; those of an unknown preset are the default's."""
        known = PRESETS.get(self.encoder_preset, DEFAULT)
        return replace(known, reading=Reading(self.encoder_reading))

    @property
    def plugin_names(self) -> str:
        """The plug-ins in words; empty where there is none."""
        return ", ".join(map(str, self.plugins))

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

    def gain(self, ranges: Normalisation) -> ForceGain | None:
        """Return the gain of the live encoder's SA current for taxel ranges, None for 1."""
        passport = read_passport(self.passport) if self.passport else None
        scaling, reading = ForceScaling(self.encoder_scaling), Reading(self.encoder_reading)
        gain_of = gain_source(scaling, passport, reading)
        return None if gain_of is None else gain_of(ranges)

    def to_attributes(self) -> Attributes:
        """Return the attributes of a part's root; sequences and mappings become JSON."""
        values = {
            name: json.dumps(value) if isinstance(value, tuple | dict) else value
            for name, value in asdict(self).items()
            if name not in _FINGER_ONLY or self.experiment != DRUM_EXPERIMENT
        }
        if self.sensor_layout is None:
            del values[ATTRIBUTE]
        if not self.plugins:
            del values["plugins"]
        return {**values, "simulated": int(self.simulated)}

    @classmethod
    def from_attributes(cls, attributes: Mapping[str, Any], path: Path) -> SessionHeader:
        """Return the inverse of :meth:`to_attributes`; ignore unknown attributes.

        ``path``: the part. Raises SessionError that names the attribute for a missing one, another
        type, and a value out of its range.
        """
        if "boards" not in attributes:
            raise damage(path, "its description", "lacks the attribute boards")
        values = {
            field.name: attributes[field.name] for field in fields(cls) if field.name in attributes
        }
        for name, wanted in JSON_ATTRIBUTES.items():
            if name in values:
                place = f"attribute {name} of the file"
                values[name] = parse_json(str(values[name]), wanted, path, place)
        if values.get("simulated") in (0, 1):
            values["simulated"] = bool(values["simulated"])
        try:
            header = msgspec.convert(values, cls)
            header._check()
        except (ValueError, RecursionError) as error:
            raise damage(path, "its description", f"is wrong: {describe(error)}") from error
        return header

    def _check(self) -> None:
        """Raise ValueError for values that do not fit each other."""
        if not math.isfinite(self.start_loop_s):
            raise ValueError(f"start_loop_s is {self.start_loop_s}")
        for name in ("taxel_low", "taxel_high", "wiring"):
            if len(getattr(self, name)) not in (0, self.n_taxels):
                raise ValueError(f"{name} is neither empty nor one integer for each taxel")
        if self.passport:
            read_passport(self.passport)
        layout = self.sensor_layout
        if layout is not None and layout.n_taxels != self.n_taxels:
            raise ValueError(
                f"sensor_layout is {layout.describe()}, but a sample has {self.n_taxels} readings"
            )


def session_wiring(header: SessionHeader, rig_text: str) -> Wiring:
    """Return the reading at each place; empty for an import, whose mapping orders its columns.

    Older parts lack the attribute: the wiring in ``rig_text`` applies to them or, if that has
    none, the order of the wire. Raises SessionError for a text that is not TOML.
    """
    if header.wiring or header.rig == IMPORTED:
        return header.wiring
    rig = TomlText("the session's description of its rig", rig_text, SessionError)
    wiring = rig.root.table("taxels").integers("wiring", (), low=0, high=MAX_TAXELS)
    return wiring or tuple(range(header.n_taxels))


def session_inputs(rig_text: str) -> int:
    """Return the analog inputs of the taxel board; the paper's where the rig does not say them.

    Raises SessionError for a text that is not TOML.
    """
    rig = TomlText("the session's description of its rig", rig_text, SessionError)
    default = PAPER_ARRAY.inputs
    return rig.root.table("taxels").integer("inputs", default, low=1, high=MAX_TAXELS)


def source_wiring(source: Mapping[str, Any]) -> Wiring:
    """Return the wiring of a source session that a model or a file of spikes lists.

    Older files have none: their sessions have the order of the wire, the default at that time.
    """
    wiring = source.get("wiring")
    if wiring is not None or source.get("rig") == IMPORTED:
        return tuple(wiring or ())
    return tuple(range(int(source.get("n_taxels", 0))))


def wirings_match(one: Wiring, other: Wiring) -> bool:
    """Return whether both have each taxel at the same place; an empty wiring matches any."""
    return not one or not other or one == other


def describe_mismatch(one: Wiring, other: Wiring) -> str:
    """Return both orders for an error message, in the syntax of ``rig.toml``."""
    return f"[taxels] wiring = {list(one)}, not {list(other)}"


def describe_new_versions(before: SessionHeader, now: SessionHeader) -> list[str]:
    """Return a sentence for the program and each board that a session's last part had otherwise.

    What a session may not be continued with, such as another plan or order of taxels, the recorder
    refuses.
    """
    programs = [f"{h.software_version} ({h.software_commit or 'no commit'})" for h in (before, now)]
    known = {board.board: board for board in before.boards}
    changes = [("rigctl", *programs)] if before.software_version else []
    changes.append(("the plug-in", before.plugin_names or "none", now.plugin_names or "none"))
    changes += [
        (f"the {board.board} board's firmware", _build(known[board.board]), _build(board))
        for board in now.boards
        if board.board in known
    ]
    return [
        f"{what} was {old} in the last part and is {new} now: the session goes on, and each part "
        "says what recorded it"
        for what, old, new in changes
        if old != new
    ]


def _build(board: BoardIdentity) -> str:
    return f"{board.firmware_version} (build {board.build_hash})"
