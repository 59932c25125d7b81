"""The engine's status message as frozen values, tolerant of fields that an engine leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from rigctl.wire.drum.states import State

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class RecordingView:
    """What has reached the disk; the recording light is derived from ``samples_last_s``."""

    active: bool = False
    samples_on_disk: int = 0
    samples_last_s: int = 0
    folder: str = ""
    disk_free_bytes: int = 0
    hours_left: float | None = None
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Prompt:
    """A question that the runner waits for a person to answer."""

    id: int = 0
    text: str = ""
    texture: str = ""


@dataclass(frozen=True, slots=True)
class RunView:
    """A protocol happening; ``current`` has texture, speed_mm_s, force_g and repeat."""

    state: str = "idle"
    text: str = ""
    reasons: tuple[str, ...] = ()
    trial_id: int = 0
    trials_planned: int = 0
    trials_committed: int = 0
    trials_rejected: int = 0
    eta_s: float | None = None
    elapsed_s: float = 0.0
    current: Mapping[str, Any] = field(default_factory=dict)
    prompt: Prompt | None = None
    session: str = ""

    @property
    def is_going(self) -> bool:
        """Whether the runner has the rig: running, paused, or waiting for an answer."""
        return self.state in ("running", "paused", "prompt")


@dataclass(frozen=True, slots=True)
class BoardView:
    """What a board says of itself, None before it is known; see the engine's message."""

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


@dataclass(frozen=True, slots=True)
class EngineStatus:
    """The whole rig as the engine told it, ten times a second."""

    rig: str = ""
    simulated: bool = False
    texture: str = ""
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
    tared: bool = False
    homed: bool = False
    frame_rate_hz: float = 0.0
    lost_samples: int = 0
    gaps: int = 0
    last_block_age_s: float | None = None
    poll_age_s: float | None = None
    poll_retries: int = 0
    loadcell_lost: int = 0
    clock_ppm: Mapping[str, float | None] = field(default_factory=dict)
    boards: Mapping[str, BoardView] = field(default_factory=dict)
    recording: RecordingView = RecordingView()
    run: RunView = RunView()


def read_status(data: Mapping[str, Any]) -> EngineStatus:
    """The status that a message's ``data`` describes; what is missing keeps its default."""
    known = dict(data)
    known["state"] = _state(data.get("state"))
    known["recording"] = _fill(RecordingView, data.get("recording") or {})
    known["boards"] = {name: _board(said) for name, said in (data.get("boards") or {}).items()}
    known["run"] = _run(data.get("run") or {})
    return _fill(EngineStatus, known)


def _run(data: Mapping[str, Any]) -> RunView:
    known = dict(data)
    known["reasons"] = tuple(data.get("reasons") or ())
    prompt = data.get("prompt")
    known["prompt"] = _fill(Prompt, prompt) if prompt else None
    return _fill(RunView, known)


def _board(data: Mapping[str, Any]) -> BoardView:
    found = data.get("self_test")
    return _fill(BoardView, {**data, "self_test": None if found is None else tuple(found)})


def _state(value: Any) -> State | None:
    if isinstance(value, str):
        return State.__members__.get(value.upper())
    return State(value) if value in State._value2member_map_ else None


def _fill(kind: type[_T], data: Mapping[str, Any]) -> _T:
    names = {f.name for f in fields(kind)}  # type: ignore[arg-type]  # every kind is a dataclass
    return kind(**{name: data[name] for name in names if data.get(name) is not None})
