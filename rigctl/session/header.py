"""What a session says before its first sample: header, sensor and wiring, attributes of every part.

The columns of the samples are the places of the sensor: layer by layer, in each layer row by row.
If two wirings differ, taxel 4 of one session is not taxel 4 of the other, so the program never
combines the two.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.config.names import name_problem, shorten
from rigctl.config.rig_config import LAYER_NAME_BYTES, MAX_TAXELS, TaxelArray
from rigctl.config.toml_reader import TomlText
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, PRESETS, EncoderParameters
from rigctl.encoding.reading import FULL_SCALE, Reading
from rigctl.errors import SessionError
from rigctl.session.hdf5_file import Attributes, parse_json, parse_objects
from rigctl.session.layout import DRUM_EXPERIMENT
from rigctl.values import N_TAXELS, SAMPLE_RATE_HZ, BoardIdentity

ATTRIBUTE = "sensor_layout"
LAYER_NAMES = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")
"""Names of layers that have none. The paper's Type I is the upper layer, Type II lies below it."""
LAYERS_SHOWN = 8
_ROMAN = re.compile("[IVX]+")
_KEYS = {"rows", "columns", "layers"}


@dataclass(frozen=True, slots=True)
class SensorLayout:
    """Rows and columns of each layer of a sensor, and its layers from the top, by name.

    Raises ValueError for sizes below 1, more than 1024 taxels, and for layers without a name or of
    the same name.
    """

    rows: int
    columns: int
    layers: tuple[str, ...]

    def __post_init__(self) -> None:
        if min(self.rows, self.columns, len(self.layers)) < 1:
            raise ValueError("a sensor has at least one row, one column and one layer")
        if self.n_taxels > MAX_TAXELS:
            raise ValueError(f"{shorten(self.describe())} are more than {MAX_TAXELS} taxels")
        for name in self.layers:
            if problem := name_problem(name, LAYER_NAME_BYTES):
                raise ValueError(f"a layer's name {problem}")
        if len(set(self.layers)) < len(self.layers):
            name = Counter(self.layers).most_common(1)[0][0]
            raise ValueError(f"two layers have the same name: {name}")

    @classmethod
    def default(cls, n_taxels: int) -> SensorLayout:
        """Return the layout of a session that does not say it.

        18 taxels are the paper's sensor, 3 × 3 in two layers. Any other number is one layer: a
        square if there is one, such as 3 × 3 or 4 × 4, else a single row.
        """
        if n_taxels == N_TAXELS:
            return cls(3, 3, LAYER_NAMES[:2])
        side = isqrt(n_taxels)
        rows = side if side * side == n_taxels else 1
        return cls(rows, n_taxels // rows, LAYER_NAMES[:1])

    @classmethod
    def of_rig(cls, taxels: TaxelArray) -> SensorLayout:
        """Return the layout that ``[taxels]`` of a rig describes.

        Without names, the layers are as many as the rows and columns leave for ``count``; where
        these do not divide it, the layout is the default of that number.
        """
        if taxels.layers:
            return cls(taxels.rows, taxels.columns, taxels.layers)
        n_layers, rest = divmod(taxels.count, taxels.rows * taxels.columns)
        if rest or not 1 <= n_layers <= len(LAYER_NAMES):
            return cls.default(taxels.count)
        return cls(taxels.rows, taxels.columns, LAYER_NAMES[:n_layers])

    @classmethod
    def from_attributes(cls, attributes: Mapping[str, Any], path: Path) -> SensorLayout:
        """Return the layout of a part with these attributes, by default that of its taxels.

        ``path``: the part. Raises SessionError for another type, a layout that cannot be, and one
        of another number of taxels than the part has.
        """
        n_taxels = int(attributes.get("n_taxels", N_TAXELS))
        if ATTRIBUTE not in attributes:
            return cls.default(n_taxels)
        layout = cls.from_json(attributes[ATTRIBUTE], path)
        if layout.n_taxels != n_taxels:
            raise _wrong_layout(path, f"{layout.describe()}, but a sample has {n_taxels} readings")
        return layout

    @classmethod
    def from_json(cls, value: object, path: Path) -> SensorLayout:
        """Return the layout in a JSON text. Raises SessionError as :meth:`from_attributes` does."""
        if not isinstance(value, str):
            raise _wrong_layout(path, "no JSON text")
        return cls.from_values(
            parse_json(value, dict, path, f"attribute {ATTRIBUTE} of the file"), path
        )

    @classmethod
    def from_values(cls, values: Mapping[str, Any], path: Path) -> SensorLayout:
        """Return the layout of the values of :meth:`to_values`. Raises SessionError."""
        layers = values.get("layers")
        sizes = values.get("rows"), values.get("columns")
        if values.keys() != _KEYS or not all(type(size) is int for size in sizes):
            raise _wrong_layout(
                path, "not an object with integers rows and columns, and a list layers"
            )
        if not isinstance(layers, list | tuple) or not all(type(name) is str for name in layers):
            raise _wrong_layout(path, "without a list of texts as layers")
        try:
            return cls(values["rows"], values["columns"], tuple(layers))
        except ValueError as error:
            raise _wrong_layout(path, f"impossible: {error}") from error

    def to_values(self) -> dict[str, Any]:
        """Return plain values for JSON: ``rows``, ``columns``, ``layers``."""
        return {**asdict(self), "layers": list(self.layers)}

    @property
    def n_taxels(self) -> int:
        """Number of taxels of all layers."""
        return self.rows * self.columns * len(self.layers)

    @property
    def per_layer(self) -> int:
        """Number of taxels of one layer."""
        return self.rows * self.columns

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each taxel: layer and number from 1, as I-1 … II-18; with one layer 1 … n."""
        names = self.layers if len(self.layers) > 1 else ("",)
        return tuple(
            f"{names[self.layer_of(taxel)]}-{taxel + 1}".removeprefix("-")
            for taxel in range(self.n_taxels)
        )

    def layer_of(self, taxel: int) -> int:
        """Return the number of a taxel's layer in ``layers``; both count from 0."""
        return taxel // self.per_layer

    def row_of(self, taxel: int) -> int:
        """Return the row of a taxel in its layer; both count from 0."""
        return taxel % self.per_layer // self.columns

    def taxels_of(self, layer: int) -> range:
        """Return the taxels of a layer; both count from 0."""
        return range(layer * self.per_layer, (layer + 1) * self.per_layer)

    def channel_name(self, channel: str, layer: int) -> str:
        """Return the name of the trains of a channel and layer.

        SAI of Roman numerals, ``SA upper`` of other names, SA where there is one layer.
        """
        if len(self.layers) == 1:
            return channel
        name = self.layers[layer]
        return f"{channel}{name}" if _ROMAN.fullmatch(name) else f"{channel} {name}"

    def train_groups(self) -> tuple[tuple[str, range], ...]:
        """Return name and rows in :class:`rigctl.values.Spikes` of the trains of each kind.

        In the paper's order: SAI, RAI, SAII, RAII; with one layer SA, RA.
        """
        return tuple(
            (self.channel_name(channel, layer), range(first + taxels.start, first + taxels.stop))
            for layer, taxels in enumerate(map(self.taxels_of, range(len(self.layers))))
            for channel, first in (("SA", 0), ("RA", self.n_taxels))
        )

    def train_names(self) -> tuple[tuple[str, int], ...]:
        """Return name and row in :class:`rigctl.values.Spikes` of each train, as SAI-1 … RAII-18.

        Trains are in the order of :meth:`train_groups`; taxels count from 1 over all layers.
        """
        return tuple(
            (f"{name}-{row % self.n_taxels + 1}", row)
            for name, rows in self.train_groups()
            for row in rows
        )

    def describe(self) -> str:
        """Return the layout in words, as 3 × 3 taxels in 2 layers (I, II); of many the first."""
        words = f"{self.rows} × {self.columns} taxels in "
        if len(self.layers) == 1:
            return f"{words}one layer"
        names = ", ".join(self.layers[:LAYERS_SHOWN])
        more = ", …" if len(self.layers) > LAYERS_SHOWN else ""
        return f"{words}{len(self.layers)} layers ({names}{more})"


def layouts_match(one: SensorLayout | None, other: SensorLayout | None) -> bool:
    """Return whether both have each taxel at the same place; None, an older part, matches any.

    Names do not matter.
    """
    if one is None or other is None:
        return True
    sizes = [(each.rows, each.columns, len(each.layers)) for each in (one, other)]
    return sizes[0] == sizes[1]


def describe_difference(one: SensorLayout | None, other: SensorLayout | None) -> str:
    """Return both layouts for an error message."""
    names = [layout.describe() if layout else "unknown" for layout in (one, other)]
    return f"{names[0]}, not {names[1]}"


def _wrong_layout(path: Path, what: str) -> SessionError:
    return SessionError(f"{path} is damaged: its attribute {ATTRIBUTE} is {what}")


TEXTS = (
    "plan_hash", "rig", "start_utc", "protocol", "operator", "sensor", "software_version",
    "software_commit", "encoder_preset", "encoder_reading", "sample_unit", "cut_by", "experiment",
)  # fmt: skip
INT64 = 1 << 63
COUNT = 1 << 31
INTEGERS = {
    "seed": (-INT64, 2 * INT64),
    "trials_planned": (0, COUNT),
    "simulated": (0, 1),
    "n_taxels": (1, MAX_TAXELS),
    "sample_rate_hz": (1, 1_000_000),
    "highest_reading": (1, 65_535),
    "reference_um_per_s": (0, COUNT),
}
"""Lowest and highest value of each integer."""
PER_TAXEL = {"taxel_low": 65_535, "taxel_high": 65_535, "wiring": MAX_TAXELS - 1}
"""Highest value of the lists with one integer for each taxel; these may also be empty."""
MAPPINGS = ("simulation", "tracker")
REQUIRED = ("plan_hash", "seed", "trials_planned", "rig", "simulated", "start_utc", "boards")
_BOARD = {
    "board": str, "firmware_version": str, "build_hash": str, "wire_version": int,
    "boot_count": int, "reset_cause": int, "details": dict,
}  # fmt: skip


def parse_header_values(attributes: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return the header's values by name, without those that an older part lacks.

    Raises SessionError that names the attribute for a missing one, another type, or a value out of
    its range. Unknown attributes are ignored.
    """
    for name in REQUIRED:
        if name not in attributes:
            raise SessionError(f"{path} is damaged: it lacks the attribute {name}")
    values: dict[str, Any] = {}
    for name in (*TEXTS, *INTEGERS, "start_loop_s"):
        if name in attributes:
            _check_plain(name, attributes[name], path)
            values[name] = attributes[name]
    n_taxels = values.get("n_taxels")
    for name in ("boards", "stages", *PER_TAXEL, *MAPPINGS):
        if name in attributes:
            values[name] = _parse(name, attributes[name], n_taxels, path)
    if ATTRIBUTE in attributes:
        values[ATTRIBUTE] = SensorLayout.from_attributes(attributes, path)
    return values


def _check_plain(name: str, value: Any, path: Path) -> None:
    if name in TEXTS:
        if not isinstance(value, str):
            raise _wrong(path, name, value, "a text")
        if name == "encoder_reading" and value not in list(Reading):
            raise _wrong(path, name, value, f"one of {', '.join(Reading)}")
    elif name in INTEGERS:
        low, high = INTEGERS[name]
        if not isinstance(value, int) or not low <= value <= high:
            raise _wrong(path, name, value, f"an integer from {low} to {high}")
    elif not isinstance(value, float | int) or not math.isfinite(value):
        raise _wrong(path, name, value, "a finite number")


def _parse(name: str, value: Any, n_taxels: int | None, path: Path) -> Any:
    place = f"attribute {name} of the file"
    if not isinstance(value, str):
        raise _wrong(path, name, value, "a JSON text")
    if name in MAPPINGS:
        return parse_json(value, dict, path, place)
    if name == "boards":
        return tuple(_board(item, path) for item in parse_objects(value, path, place))
    items = parse_json(value, list, path, place)
    if name == "stages":
        if not all(isinstance(item, str) for item in items):
            raise _wrong(path, name, value, "a list of texts")
    elif not _is_per_taxel(items, PER_TAXEL[name], n_taxels):
        raise _wrong(path, name, value, "empty or one integer for each taxel")
    return tuple(items)


def _is_per_taxel(items: list[Any], highest: int, n_taxels: int | None) -> bool:
    return len(items) in (0, n_taxels or len(items)) and all(
        type(item) is int and 0 <= item <= highest for item in items
    )


def _board(item: Mapping[str, Any], path: Path) -> BoardIdentity:
    """Return a board from its JSON object; older ones lack ``details``."""
    wanted = {name: kind for name, kind in _BOARD.items() if name != "details" or name in item}
    if item.keys() != wanted.keys() or not all(
        isinstance(item[name], kind) for name, kind in wanted.items()
    ):
        raise _wrong(path, "boards", dict(item), "a list of boards with their identities")
    return BoardIdentity(**item)


def _wrong(path: Path, name: str, value: Any, wanted: str) -> SessionError:
    shown = repr(value)
    shown = shown if len(shown) <= 60 else f"{shown[:60]}…"
    return SessionError(f"{path} is damaged: its attribute {name} is {shown}, not {wanted}")


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
    :mod:`rigctl.session.header` explains an empty one.
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


Wiring = tuple[int, ...]


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
