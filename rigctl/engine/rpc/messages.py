"""The messages between client and engine: one JSON object per line.

A client's first line is ``{"token": …}``. Then it sends requests, and the engine replies to each
one; between replies the engine sends events to every client::

    {"id": 1, "command": "arm", "args": {}}
    {"reply": 1, "ok": true, "result": {}}
    {"reply": 1, "ok": false, "error": "one sentence with a remedy", "exit_code": 3}
    {"event": "fault", "at_s": 12.3, "text": "one sentence", "data": {}}

A request that is not one, or has wrong arguments, is refused with exit code 2; without a readable
number its ``reply`` is null. The engine sends the event ``status`` ten times a second of loop time;
its ``data`` has the fields of :class:`EngineStatus`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from rigctl.boards.drum_states import Fault, State
from rigctl.config.rig_config import PAPER_ARRAY, RigLimits
from rigctl.config.text_file import shorten
from rigctl.encoder.reading import Reading
from rigctl.engine.calibration_values import (
    CalibrationStatus,
)
from rigctl.engine.setup.setup_status import STOP_PARTS, SetupStatus
from rigctl.errors import WrongUse
from rigctl.session.sensor_layout import PAPER_SENSOR, SensorLayout

LINE_LIMIT_BYTES = 1 << 20
REQUEST_LIMIT_BYTES = 1 << 16
SHOWN_LETTERS = 100
"""Of what a refusal cites from a request."""
STATUS_PERIOD_S = 0.1
DISCONNECTED = "disconnected"
"""The last event that a client gets which the engine disconnects; its text is the reason."""
DISCONNECTED_TEXT = (
    "the engine has disconnected this client, which did not read: join it again; a run goes on, "
    "and its session has everything"
)
NOMINAL_LIMITS = RigLimits()
NO_CALIBRATION = CalibrationStatus()
NO_SETUP = SetupStatus()


OPERATOR, PROMPT, LINK, DISK, FAULT = "operator", "prompt", "link", "disk", "fault"
NOISE, DISK_ERROR = "noisy link", "disk error"
"""Why a run waits."""
UNRECORDED = "unrecorded"
"""Kind of the event that a run which waits for nobody got no samples for this time:"""
NOTHING_RECORDED_S = 60.0
"""A run records while it homes, tares, presses and turns; between two plates it begins at once."""
_REASON_WORDS = {
    LINK: "a board is lost",
    DISK: "the disk is too full or too slow",
    FAULT: "a fault of the drum",
    "tracker": "the tracker is lost",
}


def reason_words(reasons: Iterable[str]) -> str:
    """Return what a run waits for in words; a question speaks for itself."""
    return ", ".join(_REASON_WORDS.get(reason, reason) for reason in reasons if reason != PROMPT)


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """What has reached the disk.

    ``active``: samples reached the disk within the last second. ``disk_free_bytes``: 0 before and
    after a recording. ``hours_left``: free space divided by the recent write rate, None before
    anything is written. ``by_hand``: without a protocol.
    """

    active: bool = False
    samples_on_disk: int = 0
    samples_last_s: int = 0
    folder: str | None = None
    disk_free_bytes: int = 0
    hours_left: float | None = None
    failure: str | None = None
    by_hand: bool = False


class LslScope(StrEnum):
    """Who can see what an engine streams over the Lab Streaming Layer."""

    OFF = "off"
    COMPUTER = "computer"
    NETWORK = "network"


@dataclass(frozen=True, slots=True)
class CurrentTrial:
    """The trial that is running."""

    texture: str = "?"
    speed_mm_s: float = 0.0
    force_g: float = 0.0
    repeat: int = 0
    mount: int = 1


@dataclass(frozen=True, slots=True)
class PromptStatus:
    """A question to the operator; ``texture`` is the plate to mount, None for a message."""

    id: int = 0
    text: str = ""
    texture: str | None = None


@dataclass(frozen=True, slots=True)
class NextPlate:
    """The next change of plates: the plate, the trials before it but the present one, and the time.

    ``left_s``: the estimate for those trials and all of the present one.
    """

    texture: str = ""
    trials: int = 0
    left_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SittingStatus:
    """Progress of a run of any experiment.

    ``state``: idle, running, paused, prompt, done, aborted or failed. ``reasons``: what the run
    waits for, words such as operator, prompt, link, disk. ``text``: one sentence on how it ended,
    empty before.
    """

    state: str = "idle"
    text: str = ""
    reasons: tuple[str, ...] = ()
    trials_planned: int = 0
    trials_committed: int = 0
    trials_rejected: int = 0
    eta_s: float | None = None
    elapsed_s: float = 0.0
    prompt: PromptStatus | None = None
    session: str | None = None

    @property
    def is_active(self) -> bool:
        """Whether the run goes on: running, paused, or waiting for an answer."""
        return self.state in ("running", "paused", "prompt")

    @property
    def has_ended(self) -> bool:
        """Whether there was a run and it is over."""
        return self.state in ("done", "aborted", "failed")

    @property
    def is_complete(self) -> bool:
        """Whether every planned trial is committed."""
        return self.trials_committed >= self.trials_planned


@dataclass(frozen=True, slots=True)
class RunStatus(SittingStatus):
    """Progress of a protocol on the drum.

    ``trials_ended_early``: planned trials that an early end of their condition left out.
    ``trial_age_s``: time since a trial was committed, None before one was in this sitting.
    ``next_plate``: None if no other one follows.
    """

    trial_id: int | None = None
    trials_ended_early: int = 0
    trial_age_s: float | None = None
    next_plate: NextPlate | None = None
    current: CurrentTrial | None = None

    @property
    def is_complete(self) -> bool:
        """Whether every planned trial is committed, or was left out by an early end."""
        return self.trials_committed + self.trials_ended_early >= self.trials_planned


@dataclass(frozen=True, slots=True)
class QueuedRunStatus:
    """A run that waits in the queue, with what its client has planned of it.

    ``duration_s``: with plate changes. ``due_s``: until it begins if nothing makes it wait, None
    while no run is active.
    """

    number: int = 0
    protocol: str = ""
    seed: int | None = None
    trials: int = 0
    plate_changes: int = 0
    duration_s: float = 0.0
    due_s: float | None = None


@dataclass(frozen=True, slots=True)
class QueueStatus:
    """The runs that wait, the next one first, and what that one waits for."""

    entries: tuple[QueuedRunStatus, ...] = ()
    waits_for: str = ""


@dataclass(frozen=True, slots=True)
class BoardStatus:
    """What a board reports about itself; ``supply_v`` and ``self_test`` only the taxel board.

    ``reset``: the cause of its last restart, in words; ``unwanted``: whether that is a problem.
    ``self_test``: one sentence per finding, empty for none, None before the result is known.
    ``late_ticks``: since the engine first connected, over the board's restarts;
    ``longest_isr_us`` and ``free_stack_bytes`` (never used): since its boot;
    ``stack_free_percent``: of the chip's RAM; ``idle_percent``: of the last second;
    ``loadcell_rate_hz``, ``loadcell_spikes`` (since its boot): of the drum only. None before they
    are known.
    """

    firmware: str = ""
    boot_count: int = 0
    reset: str = ""
    unwanted: bool = False
    supply_v: float | None = None
    self_test: tuple[str, ...] | None = None
    late_ticks: int | None = None
    longest_isr_us: float | None = None
    free_stack_bytes: int | None = None
    stack_free_percent: int | None = None
    idle_percent: float | None = None
    loadcell_rate_hz: float | None = None
    loadcell_spikes: int | None = None


@dataclass(frozen=True, slots=True)
class EngineStatus:
    """State of the rig, the recording and the run.

    ``state``: None before it is known. ``fault``: value of ``Fault``.
    ``contact_may_stand``: the drum may rest on the sensor. ``estop_pressed``: it is pressed now, or
    its wire is broken. ``has_taxel_range``: it is calibrated or measured; ``range_from``: where
    rig.toml has its ranges from. ``loadcell_calibrated``: date and masses, empty for the nominal
    scale. ``last_block_age_s``, ``poll_age_s`` and
    ``loadcell_age_s``: loop time since the newest data, None before any. ``limits``: set-points
    that the engine takes. ``loadcell_counts``, ``loadcell_sd_counts``: mean and spread of the
    last second, None before any. ``has_taxel_order``: rig.toml says which reading is which taxel,
    or they are identified. ``commissioned``: the board presses for protocols.
    ``is_moved_by_hand``: a client's own command moves the drum, so no run can start.
    ``gaps``, ``lost_samples``, ``loadcell_lost``: since the engine started; ``lost_age_s`` and
    ``loadcell_lost_age_s``: loop time since the last of them, None where that is not known.
    ``poll_retries``: repeated polls of the drum since the engine started.
    ``clock_ppm``: how fast each board's clock runs against the computer's, None before known.
    ``boards``: by name, those that have connected. ``sensor_layout``: rows, columns and layers of
    the sensor. ``reading``: what the live encoder takes of the samples, and the unit of its ranges;
    ``wiring``: the reading of the taxel wire at each place, empty where it is not known;
    ``taxel_inputs``: analog inputs of the board, a reading is inputs · line + input;
    ``full_scale``: its highest reading. ``axis_mm``: height of a further axis, None without one.
    ``registers``: those of the drum that its table marks as shown, by name, in their units.
    ``wrong_wirings``: names of those of a simulated rig that are on. ``lsl``: who can see what is
    streamed over the Lab Streaming Layer.
    """

    at_s: float = 0.0
    rig: str = ""
    simulated: bool = False
    texture: str | None = None
    wrong_wirings: tuple[str, ...] = ()
    drum_connected: bool = False
    taxels_connected: bool = False
    state: State | None = None
    state_words: str = ""
    fault: int = 0
    fault_words: str = ""
    force_g: float = 0.0
    force_set_g: float = 0.0
    speed_mm_s: float = 0.0
    speed_set_mm_s: float = 0.0
    steps: int = 0
    angle_deg: float = 0.0
    actuator_position_um: int = 0
    commissioned: bool = True
    tared: bool = False
    contact_may_stand: bool = False
    estop_pressed: bool = False
    has_taxel_range: bool = False
    range_from: str = ""
    loadcell_calibrated: str = ""
    loadcell_counts: float | None = None
    loadcell_sd_counts: float | None = None
    scale_ug_per_count: int = 0
    has_taxel_order: bool = False
    homed: bool = False
    is_moved_by_hand: bool = False
    frame_rate_hz: float = 0.0
    lost_samples: int = 0
    gaps: int = 0
    lost_age_s: float | None = None
    last_block_age_s: float | None = None
    poll_age_s: float | None = None
    loadcell_age_s: float | None = None
    poll_retries: int = 0
    loadcell_lost: int = 0
    loadcell_lost_age_s: float | None = None
    clock_ppm: Mapping[str, float | None] = field(default_factory=dict)
    boards: Mapping[str, BoardStatus] = field(default_factory=dict)
    sensor_layout: SensorLayout = PAPER_SENSOR
    reading: Reading = Reading.COUNTS
    wiring: tuple[int, ...] = ()
    taxel_inputs: int = PAPER_ARRAY.inputs
    full_scale: int = PAPER_ARRAY.full_scale
    axis_mm: float | None = None
    registers: dict[str, float] = field(default_factory=dict)
    limits: RigLimits = NOMINAL_LIMITS
    recording: RecordingStatus = RecordingStatus()
    run: RunStatus = RunStatus()
    queue: QueueStatus = QueueStatus()
    lsl: LslScope = LslScope.OFF
    calibration: CalibrationStatus = NO_CALIBRATION
    setup: SetupStatus = NO_SETUP

    @property
    def is_left_in_contact(self) -> bool:
        """Whether the drum was switched off where it pressed; no tare is from before a boot."""
        is_off = self.drum_connected and self.state in (State.IDLE, State.FAULT_OFF)
        return is_off and self.contact_may_stand and self.tared

    @property
    def is_stop_asked_for(self) -> bool:
        """Whether the emergency stop is pressed because the setup asks for it."""
        return self.fault == Fault.ESTOP and self.setup.checking in STOP_PARTS


def as_dict(status: Any) -> dict[str, Any]:
    """Return the fields of one of the dataclasses above; nested ones stay dataclasses."""
    return {each.name: getattr(status, each.name) for each in fields(status)}


def parse_status(data: Mapping[str, Any]) -> EngineStatus:
    """Return the status in a message's ``data``; missing fields get their defaults.

    Raises ValueError with the field whose value is of another type.
    """
    return msgspec.convert(data, EngineStatus)


@dataclass(frozen=True, slots=True)
class Client:
    """A client that has told its name to the others."""

    id: int
    name: str


@dataclass(frozen=True, slots=True)
class ControlState:
    """The clients of an engine and who has control, None for nobody.

    ``asking``: who asks for it, the longest waiting first.
    """

    clients: tuple[Client, ...] = ()
    holder: int | None = None
    asking: tuple[int, ...] = ()

    @property
    def holder_name(self) -> str:
        """The name of the one that has control, empty for nobody."""
        return "" if self.holder is None else self.name_of(self.holder)

    def name_of(self, client: int) -> str:
        """Return the name of a client."""
        return next((each.name for each in self.clients if each.id == client), f"client {client}")


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of Python's, which messages hold."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no value of a message")


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


def encode_message(message: dict[str, Any]) -> bytes:
    """Return one message as one line; dataclasses become objects, NaN becomes null."""
    return _ENCODER.encode(message) + b"\n"


def decode_message(line: bytes) -> dict[str, Any]:
    """Return the message in one line. Raises ValueError where it is not a JSON object."""
    try:
        return msgspec.json.decode(line, type=dict[str, Any])
    except RecursionError as error:
        raise ValueError("a message has fewer levels") from error


class EngineRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request of a client; its reply has the same number."""

    id: Annotated[int, Meta(ge=0, lt=1 << 53)]
    command: Annotated[str, Meta(max_length=64)]
    args: dict[str, Any] = {}


def decode_request(line: bytes) -> EngineRequest:
    """Return the request in one line. Raises WrongUse where it is none."""
    try:
        return msgspec.json.decode(line, type=EngineRequest)
    except (ValueError, RecursionError) as error:
        what = shorten(str(error).replace("`", ""), SHOWN_LETTERS)
        raise WrongUse(
            f'this is no request ({what}): send {{"id": 1, "command": "status", "args": {{}}}}'
        ) from error


def engine_message(kind: str, text: str, data: object, at_s: float = 0.0) -> dict[str, Any]:
    """Return a message of the engine: an event or a status, with one sentence and its data."""
    return {"event": kind, "at_s": at_s, "text": text, "data": data}
