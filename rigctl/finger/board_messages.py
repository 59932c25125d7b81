"""The finger board's frames as values; ``docs/reference/finger-wire.md`` describes the layout."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.drum_registers import MAGIC
from rigctl.boards.taxel_frames import frame
from rigctl.encoder.force_gain import KNOTS, UNIT, ForceGain
from rigctl.errors import WrongUse

WIRE_VERSION = 2
BOARD_FINGER = 3
N_TAXELS = 9
BATCH_SAMPLES = 100
DEFAULT_REFERENCE_UM_PER_S = 100_000
GAIN_PARTS = 5
"""Requests that carry one gain."""
NO_GAIN = ForceGain(0, (UNIT,) * (KNOTS + 1), (0,) * N_TAXELS)
"""The gain of a board until it is set: 1, which leaves every reading as it is."""


class RequestType(IntEnum):
    """First byte of a request to the board."""

    IDENTIFY = 0x20
    READ_SETTINGS = 0x21
    SET_RANGES = 0x22
    SET_REFERENCE = 0x23
    START = 0x24
    VELOCITY = 0x25
    STOP = 0x26
    SET_MEAN = 0x27
    SET_GAIN = 0x28


class Result(IntEnum):
    """The board's answer to a request."""

    OK = 0
    WRONG_VALUE = 1
    SCANNING = 2
    NOT_WAITING = 3
    NO_MODEL = 4


class VelocitySource(IntEnum):
    """Where the velocity of a batch came from.

    Late: HELD is the velocity of the batch before, MISSING is 0 because none has arrived yet.
    """

    RECEIVED = 0
    HELD = 1
    MISSING = 2


class SampleFlag(IntFlag):
    """Flags of a sample."""

    IN_SCAN = 1
    FIRST = 2
    LOST_BEFORE = 4


@dataclass(frozen=True, slots=True)
class FingerIdentity:
    """Identity that the board sends at boot and on request."""

    magic: int
    wire_version: int
    board_id: int
    firmware_version: int
    build_hash: int
    n_taxels: int
    rate_hz: int
    batch_samples: int

    @property
    def is_finger(self) -> bool:
        """True where the frame is that of a finger board whose wire this program speaks."""
        known = (MAGIC, WIRE_VERSION, BOARD_FINGER, N_TAXELS)
        return known == (self.magic, self.wire_version, self.board_id, self.n_taxels)


@dataclass(frozen=True, slots=True)
class FingerStatus:
    """Counters since boot, sent with every 100th sample."""

    wire_version: int
    samples: int
    lost_samples: int
    late_velocities: int
    early_velocities: int
    damaged_requests: int
    damaged_frames: int
    dropped_frames: int


def gain_crc(gain: ForceGain) -> int:
    """Return the CRC-32 of a gain as settings have it: of its shift, then of all its knots."""
    return zlib.crc32(struct.pack(f"<B{KNOTS + 1}H", gain.shift, *gain.gains))


@dataclass(frozen=True, slots=True)
class FingerSettings:
    """Lowest and highest reading of each taxel, the reference speed, and the CRC of the gain, as
    the board uses them.
    """

    low: tuple[int, ...]
    high: tuple[int, ...]
    reference_um_per_s: int = DEFAULT_REFERENCE_UM_PER_S
    gain_crc: int = gain_crc(NO_GAIN)

    @classmethod
    def from_fields(cls, *fields: int) -> Self:
        """Return the settings from the fields of a frame."""
        return cls(fields[:N_TAXELS], fields[N_TAXELS:-2], *fields[-2:])


@dataclass(frozen=True, slots=True)
class Answer:
    """The board's answer to a request that changes something."""

    request: RequestType
    result: Result
    scan: int


@dataclass(frozen=True, slots=True)
class BatchReport:
    """A batch that the board has scaled: which velocity it used, and where it began."""

    scan: int
    batch: int
    velocity_um_per_s: int
    source: VelocitySource
    samples: int
    lost_samples: int
    start_nm: int


@dataclass(frozen=True, slots=True)
class WindowReport:
    """Spikes of each taxel in one window of scaled time, and the real time it took in ms."""

    scan: int
    window: int
    real_ms: int
    spikes: tuple[int, ...]

    @classmethod
    def from_fields(cls, scan: int, window: int, real_ms: int, *spikes: int) -> Self:
        """Return the report from the fields of a frame."""
        return cls(scan, window, real_ms, spikes)

    @property
    def rates_hz(self) -> tuple[float, ...]:
        """Spikes per second of real time of each taxel: the features of this window."""
        return tuple(spikes * 1000.0 / self.real_ms for spikes in self.spikes)


@dataclass(frozen=True, slots=True)
class ScanEnded:
    """The scan has its last window."""

    scan: int


@dataclass(frozen=True, slots=True)
class BoardPrediction:
    """A classifier on the board: the best class of a scan, and the discriminant of each."""

    scan: int
    best: int
    discriminants: tuple[float, ...]


Message = (
    FingerIdentity
    | FingerStatus
    | FingerSettings
    | Answer
    | BatchReport
    | WindowReport
    | ScanEnded
    | BoardPrediction
)

DATA_TYPE = 0x31
PREDICTION_TYPE = 0x38
REPORT_TYPES = frozenset({0x35, 0x36, 0x37, PREDICTION_TYPE})
"""Batches, windows, ends and predictions of a scan: no two of them are the same."""
_PREDICTION = struct.Struct("<IBB")
_LAYOUTS: dict[int, tuple[struct.Struct, Callable[..., Message]]] = {
    0x30: (struct.Struct("<HBBHIBHB"), FingerIdentity),
    0x32: (struct.Struct("<B7I"), FingerStatus),
    0x33: (struct.Struct("<9H9HII"), FingerSettings.from_fields),
    0x34: (
        struct.Struct("<BBI"),
        lambda request, result, scan: Answer(RequestType(request), Result(result), scan),
    ),
    0x35: (
        struct.Struct("<IIIBBBQ"),
        lambda scan, batch, velocity, source, *others: BatchReport(
            scan, batch, velocity, VelocitySource(source), *others
        ),
    ),
    0x36: (struct.Struct("<IHH9H"), WindowReport.from_fields),
    0x37: (struct.Struct("<I"), ScanEnded),
}


def decode_message(body: bytes) -> Message | None:
    """Return the message in a frame's body; None for an unknown type, size or code."""
    if body[0] == PREDICTION_TYPE:
        return _decode_prediction(body)
    known = _LAYOUTS.get(body[0])
    if known is None or known[0].size != len(body) - 1:
        return None
    layout, make = known
    try:
        return make(*layout.unpack_from(body, 1))
    except ValueError:  # a code that this program does not know
        return None


def _decode_prediction(body: bytes) -> BoardPrediction | None:
    if len(body) < 1 + _PREDICTION.size:
        return None
    scan, best, classes = _PREDICTION.unpack_from(body, 1)
    values = body[1 + _PREDICTION.size :]
    if len(values) != 8 * classes or best >= classes:
        return None
    return BoardPrediction(scan, best, struct.unpack(f"<{classes}d", values))


def identify() -> bytes:
    """Return the request for the identity."""
    return frame(bytes([RequestType.IDENTIFY]))


def read_settings() -> bytes:
    """Return the request for the settings."""
    return frame(bytes([RequestType.READ_SETTINGS]))


def set_ranges(low: tuple[int, ...], high: tuple[int, ...]) -> bytes:
    """Return the request that sets the lowest and highest reading of each taxel."""
    return frame(struct.pack("<B9H9H", RequestType.SET_RANGES, *low, *high))


def set_reference(reference_um_per_s: int) -> bytes:
    """Return the request that sets the reference speed of scaled time."""
    return frame(struct.pack("<BI", RequestType.SET_REFERENCE, reference_um_per_s))


def start(scan: int) -> bytes:
    """Return the request that starts a scan with the next sample."""
    return frame(struct.pack("<BI", RequestType.START, scan))


def velocity(scan: int, batch: int, velocity_um_per_s: int) -> bytes:
    """Return the request that gives a batch its mean velocity."""
    return frame(struct.pack("<BIII", RequestType.VELOCITY, scan, batch, velocity_um_per_s))


def set_mean(window: int, mean_hz: Sequence[float]) -> bytes:
    """Return the request that replaces the mean features of a window, one for each taxel."""
    return frame(struct.pack("<BB9d", RequestType.SET_MEAN, window, *mean_hz))


def set_gain(gain: ForceGain) -> bytes:
    """Return the requests that set the gain; its base is the board's lowest readings."""
    n = len(gain.gains) // GAIN_PARTS
    return b"".join(
        frame(struct.pack(f"<BBB{n}H", RequestType.SET_GAIN, part, gain.shift, *knots))
        for part in range(GAIN_PARTS)
        for knots in [gain.gains[part * n : (part + 1) * n]]
    )


def stop(scan: int) -> bytes:
    """Return the request that closes the scan's last batch."""
    return frame(struct.pack("<BI", RequestType.STOP, scan))


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
