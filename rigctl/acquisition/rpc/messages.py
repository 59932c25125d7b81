"""What client and engine say to each other: one JSON object a line.

A client's first line is ``{"token": …}``. Then it sends requests and the engine answers each;
between answers the engine tells everybody what happens::

    {"id": 1, "command": "arm", "args": {}}
    {"reply": 1, "ok": true, "result": {}}
    {"reply": 1, "ok": false, "error": "one sentence with the cure", "exit_code": 3}
    {"event": "fault", "at_s": 12.3, "text": "one sentence", "data": {}}

Ten times a second of loop time the event ``status`` says how things stand; :class:`StatusData`
is its ``data``.
"""

from __future__ import annotations

import json
from typing import Any, TypedDict

LINE_LIMIT_BYTES = 1 << 20
STATUS_PERIOD_S = 0.1


class RecordingStatus(TypedDict):
    """Whether samples reach the disk, judged by those that did.

    ``active``: samples reached the disk within the last second. ``hours_left``: free space
    over the bytes a second written of late, None before anything was written.
    """

    active: bool
    samples_on_disk: int
    samples_last_s: int
    folder: str | None
    disk_free_bytes: int
    hours_left: float | None
    failure: str | None


class CurrentTrial(TypedDict):
    """The trial that runs now."""

    texture: str
    speed_mm_s: float
    force_g: float
    repeat: int


class PromptStatus(TypedDict):
    """A question to the operator; ``texture`` is the plate asked for, None for a message."""

    id: int
    text: str
    texture: str | None


class RunStatus(TypedDict):
    """How the protocol stands; ``state`` idle|running|paused|prompt|done|aborted|failed.

    ``reasons``: what the run waits for, words such as operator, prompt, link, disk.
    ``text``: one sentence on how it ended, empty before.
    """

    state: str
    text: str
    reasons: list[str]
    trial_id: int | None
    trials_planned: int
    trials_committed: int
    trials_rejected: int
    eta_s: float | None
    elapsed_s: float
    current: CurrentTrial | None
    prompt: PromptStatus | None
    session: str | None


class BoardStatus(TypedDict):
    """What a board says of itself; ``supply_v`` and ``self_test`` only the taxel board.

    ``reset``: what restarted it last, in words; ``unwanted``: whether that tells of trouble.
    ``self_test``: sentences of what it found, empty where all is well, None before it is known.
    ``late_ticks``: since the engine heard of the board, over its restarts; ``longest_isr_us``
    and ``free_stack_bytes``, never used: since its boot; ``stack_free_percent``: of the chip's
    RAM; ``idle_percent``: of the last second. None before they are known.
    """

    firmware: str
    boot_count: int
    reset: str
    unwanted: bool
    supply_v: float | None
    self_test: list[str] | None
    late_ticks: int | None
    longest_isr_us: float | None
    free_stack_bytes: int | None
    stack_free_percent: int | None
    idle_percent: float | None


class StatusData(TypedDict):
    """Everything a window shows as numbers, ten times a second.

    ``state`` and ``fault`` are values of ``State`` and ``Fault``, ``*_words`` say them.
    ``last_block_age_s`` and ``poll_age_s``: loop time since the newest data, None before any.
    ``poll_retries``: polls of the drum that were asked again, since the engine started.
    ``clock_ppm``: how fast each board's clock runs against the computer's, None before known.
    ``boards``: by name, those that have introduced themselves.
    """

    at_s: float
    rig: str
    simulated: bool
    texture: str | None
    drum_connected: bool
    taxels_connected: bool
    state: int
    state_words: str
    fault: int
    fault_words: str
    force_g: float
    force_set_g: float
    speed_mm_s: float
    speed_set_mm_s: float
    steps: int
    angle_deg: float
    actuator_position_um: int
    tared: bool
    homed: bool
    frame_rate_hz: float
    lost_samples: int
    gaps: int
    last_block_age_s: float | None
    poll_age_s: float | None
    poll_retries: int
    loadcell_lost: int
    clock_ppm: dict[str, float | None]
    boards: dict[str, BoardStatus]
    recording: RecordingStatus
    run: RunStatus


def encode_message(message: dict[str, Any]) -> bytes:
    """One message as one line."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def decode_message(line: bytes) -> dict[str, Any]:
    """One line as a message; ValueError where it is not a JSON object."""
    message = json.loads(line)
    if not isinstance(message, dict):
        raise ValueError("a message is a JSON object")
    return message
