"""The rig as its owner describes it: ``rig.toml`` to a frozen :class:`RigConfig` and back.

Every key has a default, which is that of the nominal rig; an empty file is a valid one.
``docs/reference/rig-toml.md`` lists them from the same fields. A mistake raises ConfigError,
which names file, line and key.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from math import isqrt
from pathlib import Path
from typing import Any

from rigctl.config.toml_reader import (
    TomlTable,
    TomlText,
    arguments,
    flag,
    names,
    number,
    read_section,
    text,
)
from rigctl.errors import ConfigError
from rigctl.values import DRAWN_WIRING, SCALE_BAND_UG_PER_COUNT

ADC_MAX = 1023
MAX_READING = 65_535
MAX_TAXELS = 1024
LAYER_NAME_BYTES = 24
LAYER_NAMES = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")
"""Names of layers that have none. The paper's Type I is the upper layer, Type II lies below it."""
_SCALES = SCALE_BAND_UG_PER_COUNT


@dataclass(frozen=True, slots=True)
class About:
    """Names that every session stores."""

    name: str = text("nominal", "name of this rig")
    operator: str = text("", "person who records")
    sensor: str = text("", "name of the sensor")
    ask: tuple[str, ...] = names(
        "a lab's own fields, asked at the start of each session and kept in it", 12, 40
    )


@dataclass(frozen=True, slots=True)
class Ports:
    """Serial ports of the boards, or simulated boards instead."""

    drum: str = text("", "port of the drum board; empty: search all ports")
    taxels: str = text("", "port of the taxel board; empty: search all ports")
    simulate: str = text(
        "",
        "virtual or firmware: simulated boards, wired as this file says",
        ("", "virtual", "firmware"),
    )


@dataclass(frozen=True, slots=True)
class DrumGeometry:
    """The drum, its plate, and the place of a trial on it."""

    circumference_mm: float = number(400, "mm", 50, 5000, "texture travel of one turn")
    plate_start_mm: float = number(10, "mm", 0, 5000, "from the index mark to the plate's start")
    plate_length_mm: float = number(370, "mm", 10, 5000, "texture on the plate")
    run_in_mm: float = number(100, "mm", 0, 200, "ramp and settling before the recorded window")
    sync_margin_mm: float = number(5, "mm", 0, 50, "sync stays high this far past the window")
    acceleration_mm_s2: float = number(600, "mm/s²", 50, 2000, "acceleration of every ramp")
    rapid_mm_s: float = number(200, "mm/s", 5, 300, "speed of moves between trials, lifted")
    backwards: bool = flag(False, "the drum's forward is the motor's backward")
    level_joint: bool = flag(
        False, "what the plate leaves of a turn carries the sensor as the plate does"
    )


@dataclass(frozen=True, slots=True)
class RigLimits:
    """Limits of a protocol, and the force at which the board lifts."""

    speed_min_mm_s: float = number(20, "mm/s", 5, 200, "lowest speed in contact")
    speed_max_mm_s: float = number(150, "mm/s", 5, 200, "highest speed in contact")
    force_min_g: float = number(50, "g", 50, 1500, "lowest force")
    force_max_g: float = number(1200, "g", 50, 1500, "highest force of a protocol")
    over_force_g: float = number(1400, "g", 100, 3000, "force at which the board lifts")


@dataclass(frozen=True, slots=True)
class Actuator:
    """The actuator that presses and lifts the drum, and its force loop."""

    lift_clearance_mm: float = number(3, "mm", 0.5, 20, "lift above the last contact")
    approach_limit_mm: float = number(30, "mm", 0.5, 50, "longest way to contact; more is a fault")
    approach_timeout_s: float = number(10, "s", 0.5, 30, "longest time to settle; more is a fault")
    stiffness_g_per_mm: float = number(900, "g/mm", 50, 5000, "estimate of the stiffest contact")
    dead_band_permille: int = number(100, "‰", 0, 500, "lowest duty that moves the actuator")
    gain_p_per_s: float = number(6, "1/s", 0.01, 50, "proportional gain of error over stiffness")
    gain_i_per_s: float = number(5, "1/s", 0, 50, "integral gain of the force loop")


SLOW_GAINS = 4.0, 1.5
"""Highest gains for a load cell of 10 samples a second, 1/s: with them the variant of the tests
holds a force before it is tuned (``tests/firmware/drum/support/other_drum.py``)."""


@dataclass(frozen=True, slots=True)
class LoadCell:
    """Conversion of the amplifier's counts to grams."""

    scale_ug_per_count: int = number(
        2400, "µg/count", -_SCALES[1], _SCALES[1], "sign included; from calibration with masses"
    )
    calibrated: str = text("", "date and masses of the calibration, for people")
    rate_hz: int = number(
        80, "samples/s", 10, 80, "of the amplifier: 80 with its RATE pin high, 10 with it low"
    )


@dataclass(frozen=True, slots=True)
class Clocks:
    """Measured errors of the boards' clocks."""

    drum_ppm: float = number(0, "ppm", -10000, 10000, "error of the drum board; positive: fast")
    taxels_ppm: float = number(0, "ppm", -10000, 10000, "error of the taxel board; positive: fast")


@dataclass(frozen=True, slots=True)
class Signals:
    """Optional wires that are fitted."""

    estop: bool = flag(True, "emergency stop")
    index: bool = flag(True, "index mark of the drum")
    end_switches: bool = flag(True, "end switches of the actuator")
    position: bool = flag(True, "position potentiometer of the actuator")
    sync: bool = flag(True, "sync line to the taxel board; else the drum's clock cuts trials")


@dataclass(frozen=True, slots=True)
class Inverted:
    """Optional wires whose level means the opposite of what the wiring drawing says."""

    estop: bool = flag(False, "contact that closes when pressed: a broken wire goes unnoticed")
    index: bool = flag(False, "mark reads low")
    end_switches: bool = flag(False, "switches that close at the end")
    position: bool = flag(False, "potentiometer with its highest reading at the upper end")
    sync: bool = flag(False, "line is high outside the window: an inverter in the wire")


@dataclass(frozen=True, slots=True)
class TaxelArray:
    """The sensor: how many taxels, their order and their calibrated range."""

    count: int = number(len(DRAWN_WIRING), "", 1, MAX_TAXELS, "taxels in a frame")
    inputs: int = number(
        6, "", 1, MAX_TAXELS, "analog inputs of the board: a reading is inputs · line + input"
    )
    rows: int = number(3, "", 1, MAX_TAXELS, "rows of a layer")
    columns: int = number(3, "", 1, MAX_TAXELS, "columns of a layer")
    layers: tuple[str, ...] = names(
        "names of the layers from the top; empty: I, II … as many as count needs",
        MAX_TAXELS,
        LAYER_NAME_BYTES,
    )
    wiring: tuple[int, ...] = number(
        (), "", 0, MAX_TAXELS, "reading at each place, layer by layer; empty: as drawn"
    )
    pressure_raises: bool = flag(True, "a pressed taxel reads higher")
    driver: str = text(
        "rigctl", "rigctl: the wire of arduino/taxels; else the name of a sensor from a package"
    )
    full_scale: int = number(ADC_MAX, "counts", 1, MAX_READING, "highest reading of the board")
    low: tuple[int, ...] = number((), "counts", 0, MAX_READING, "lowest reading of each taxel")
    high: tuple[int, ...] = number((), "counts", 0, MAX_READING, "highest reading of each taxel")
    range_from: str = text("", "date and source of the range, for people")
    passport: str = text(
        "", "sensor.json of rigctl calibrate sensor, beside this file; sessions carry it"
    )

    @property
    def order(self) -> tuple[int, ...]:
        """Return the reading at each place: ``wiring``, or the order of the wiring drawing."""
        return self.wiring or self.drawn_order

    @property
    def drawn_order(self) -> tuple[int, ...]:
        """Return the order of the drawing, which shows the paper's sensor; of others that read."""
        return DRAWN_WIRING if self.count == len(DRAWN_WIRING) else tuple(range(self.count))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return rows and columns of a layer, and layers: as many as ``count`` needs.

        Where rows and columns do not divide ``count``, the shape is :func:`usual_shape`.
        """
        if self.layers:
            return self.rows, self.columns, len(self.layers)
        n_layers, rest = divmod(self.count, self.rows * self.columns)
        if rest or not 1 <= n_layers <= len(LAYER_NAMES):
            return usual_shape(self.count)
        return self.rows, self.columns, n_layers


PAPER_ARRAY = TaxelArray()
"""The paper's sensor: 3 × 3 taxels in two layers, three lines across six inputs."""


def usual_shape(n_taxels: int) -> tuple[int, int, int]:
    """Return rows, columns and layers of a sensor of which only the number of taxels is known.

    As many as the paper's sensor has are its 3 × 3 in two layers. Any other number is one layer: a
    square if there is one, such as 3 × 3 or 4 × 4, else a single row.
    """
    if n_taxels == len(DRAWN_WIRING):
        return 3, 3, 2
    side = isqrt(n_taxels)
    rows = side if side * side == n_taxels else 1
    return rows, n_taxels // rows, 1


@dataclass(frozen=True, slots=True)
class AxisConfig:
    """A further vertical axis on a board of its own, which moves while the drum is off."""

    driver: str = text("", "name of an actuator from a package; empty: there is no axis")
    port: str = text("", "port of its board")
    low_mm: float = number(0, "mm", -1000, 1000, "lowest height that it may move to")
    high_mm: float = number(0, "mm", -1000, 1000, "greatest height that it may move to")


@dataclass(frozen=True, slots=True)
class EncoderConfig:
    """The live encoder."""

    preset: str = text("default", "name of an encoder preset")
    reading: str = text(
        "counts",
        "counts, or conductance: without the load of the other taxels of an input",
        ("counts", "conductance"),
    )
    force_scaling: str = text(
        "none",
        "what scales the SA current for the force: none, divided, or calibrated by the passport",
        ("none", "divided", "calibrated"),
    )


@dataclass(frozen=True, slots=True)
class RecordingConfig:
    """How sessions are recorded."""

    private: bool = flag(False, "only the user who records can read the session")
    copy_to: str = text(
        "", "whole path of a folder on a second disk, to which a run copies what is finished"
    )
    streams: tuple[str, ...] = arguments(
        "LSL streams of other programs to record beside each session: names, or as type=EEG"
    )


STREAM_KEYS = ("name", "type", "source_id")


def stream_predicate(words: str) -> str:
    """Return LSL's own condition for a stream: ``KEY=VALUE`` of the keys above, or a name.

    Raises ValueError where the words have quotes, or name nothing.
    """
    key, _, value = words.partition("=")
    if key not in STREAM_KEYS or not value:
        key, value = "name", words
    if not value.strip() or set(value) & set("'\""):
        raise ValueError(f"{words} names no stream")
    return f"{key}='{value}'"


@dataclass(frozen=True, slots=True)
class RunConfig:
    """What happens while a run goes on."""

    on_event: tuple[str, ...] = arguments(
        "program and its arguments that tell somebody; gets kind and text of an event as two more"
    )


@dataclass(frozen=True, slots=True)
class RigConfig:
    """One rig. Each field is a table of ``rig.toml``."""

    about: About = About()
    ports: Ports = Ports()
    drum: DrumGeometry = DrumGeometry()
    limits: RigLimits = RigLimits()
    actuator: Actuator = Actuator()
    loadcell: LoadCell = LoadCell()
    clocks: Clocks = Clocks()
    signals: Signals = Signals()
    inverted: Inverted = Inverted()
    taxels: TaxelArray = TaxelArray()
    axis: AxisConfig = AxisConfig()
    encoder: EncoderConfig = EncoderConfig()
    recording: RecordingConfig = RecordingConfig()
    run: RunConfig = RunConfig()

    def with_order(self) -> RigConfig:
        """Return this rig with the order of its taxels written out, even if it is the drawing's."""
        return replace(self, taxels=replace(self.taxels, wiring=self.taxels.order))

    def to_toml(self) -> str:
        """Return the whole description as TOML, each key with its unit and meaning."""
        return "\n".join(_section_toml(f.name, getattr(self, f.name)) for f in fields(self))


def load_config(path: Path) -> RigConfig:
    """Read ``rig.toml``. Raises ConfigError."""
    return _config(TomlText.read(path, ConfigError))


def parse_config(text: str, name: str = "rig.toml") -> RigConfig:
    """Read a description from a text. Raises ConfigError, which begins with ``name``."""
    return _config(TomlText(name, text, ConfigError))


def _config(text: TomlText) -> RigConfig:
    root = text.root
    tables = {f.name: root.table(f.name) for f in fields(RigConfig)}
    root.finish()
    default = RigConfig()
    config = RigConfig(
        **{
            name: read_section(table, type(getattr(default, name)))
            for name, table in tables.items()
        }
    )
    check_recording(config.recording, tables["recording"])
    _check_geometry(config.drum, tables["drum"])
    _check_limits(config.limits, tables["limits"])
    _check_taxels(config.taxels, tables["taxels"])
    if config.axis.driver and config.axis.low_mm >= config.axis.high_mm:
        tables["axis"].fail("low_mm", "must be below high_mm")
    _check_scale(config.loadcell, tables["loadcell"])
    _check_rate(config.loadcell, config.actuator, tables["loadcell"])
    return config


def check_recording(recording: RecordingConfig, table: TomlTable) -> None:
    """Raise the error of the table's text for a second disk or a stream that cannot be named so."""
    if recording.copy_to and not Path(recording.copy_to).is_absolute():
        table.fail("copy_to", "must be a whole path, such as /media/second/sessions")
    for words in recording.streams:
        try:
            stream_predicate(words)
        except ValueError:
            table.fail("streams", f"must name LSL streams without quotes, not {words!r}")


def _check_geometry(drum: DrumGeometry, table: TomlTable) -> None:
    end, turn = drum.plate_start_mm + drum.plate_length_mm, drum.circumference_mm
    if end > turn:
        message = f"the plate would end at {end:g} mm, beyond the turn of {turn:g} mm"
        table.fail("plate_length_mm", message)


def _check_limits(limits: RigLimits, table: TomlTable) -> None:
    if limits.speed_min_mm_s > limits.speed_max_mm_s:
        table.fail("speed_min_mm_s", "is above speed_max_mm_s")
    if limits.force_min_g > limits.force_max_g:
        table.fail("force_min_g", "is above force_max_g")
    if limits.force_max_g * 1.1 > limits.over_force_g:
        table.fail(
            "over_force_g", "must leave 10 % above force_max_g, or an overshoot stops the rig"
        )


def _check_taxels(taxels: TaxelArray, table: TomlTable) -> None:
    placed = taxels.rows * taxels.columns * len(taxels.layers)
    if placed and placed != taxels.count:
        table.fail(
            "layers", f"with rows and columns place {placed} taxels, count is {taxels.count}"
        )
    for name in ("wiring", "low", "high"):
        values = getattr(taxels, name)
        if values and len(values) != taxels.count:
            table.fail(name, f"has {len(values)} entries for {taxels.count} taxels")
    if bool(taxels.low) != bool(taxels.high):
        table.fail("low" if taxels.high else "high", "is missing: give both low and high")
    if max(taxels.high, default=0) > taxels.full_scale:
        table.fail("high", f"is above full_scale, {taxels.full_scale}")
    if taxels.driver == "rigctl" and taxels.full_scale != ADC_MAX:
        table.fail("full_scale", f"is {ADC_MAX} of the board of arduino/taxels")
    if any(low >= high for low, high in zip(taxels.low, taxels.high, strict=True)):
        table.fail("low", "each taxel's low must be below its high")
    if taxels.wiring and sorted(taxels.wiring) != list(range(taxels.count)):
        table.fail("wiring", f"must contain each of 0 to {taxels.count - 1} once")


def _check_scale(loadcell: LoadCell, table: TomlTable) -> None:
    scale = loadcell.scale_ug_per_count
    if abs(scale) < _SCALES[0]:
        table.fail(
            "scale_ug_per_count",
            f"{scale} µg a count is too little for a load cell, which has {_SCALES[0]} to "
            f"{_SCALES[1]} of either sign; the drum would press too hard: calibrate it",
        )


def _check_rate(loadcell: LoadCell, actuator: Actuator, table: TomlTable) -> None:
    if loadcell.rate_hz not in (10, 80):
        table.fail("rate_hz", "an HX711 gives 80 samples a second, or 10 with its RATE pin low")
    gains = actuator.gain_p_per_s, actuator.gain_i_per_s
    if loadcell.rate_hz == 10 and (gains[0] > SLOW_GAINS[0] or gains[1] > SLOW_GAINS[1]):
        table.fail(
            "rate_hz",
            f"at 10 samples a second the force would swing with gains of {gains[0]:g} and "
            f"{gains[1]:g}: set gain_p_per_s = {SLOW_GAINS[0]:g} and gain_i_per_s = "
            f"{SLOW_GAINS[1]:g} in [actuator], then run rigctl calibrate force",
        )


def _section_toml(name: str, section: Any) -> str:
    lines = [f"# {(type(section).__doc__ or '').strip()}", f"[{name}]"]
    for item in fields(section):
        unit = f"{item.metadata['unit']}: " if item.metadata["unit"] else ""
        value = _toml(getattr(section, item.name))
        lines.append(f"{item.name} = {value}  # {unit}{item.metadata['doc']}")
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    """Return a value as TOML; a JSON text is a TOML text, except for DEL."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
