"""Runs that wait in the engine for the one before them, in an order that clients change.

The queue is as old as its engine: what of it has not run ends with the process, which says so.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Annotated, TypeVar

from msgspec import Meta

from rigctl.config.resources import find_protocol
from rigctl.engine.rpc.commands import Amount, Number
from rigctl.engine.rpc.messages import QueuedRunStatus, QueueStatus, RunStatus, reason_words
from rigctl.engine.run_request import RunRequest
from rigctl.errors import WrongUse

MAX_ENTRIES = 100
Shift = Annotated[int, Meta(ge=-MAX_ENTRIES, le=MAX_ENTRIES)]
Started = TypeVar("Started")
NOT_STARTED = "Start next begins the first one"


class QueuedRun(RunRequest, frozen=True, forbid_unknown_fields=True):
    """A run for the queue; ``out`` is the folder in which its session gets a folder of its own.

    ``trials``, ``plate_changes`` and ``duration_s``, with plate changes, are what the client has
    planned; other clients see them.
    """

    trials: Number = 0
    plate_changes: Number = 0
    duration_s: Amount = 0.0

    def __post_init__(self) -> None:
        if self.protocol is None or self.out is None or self.resume is not None:
            raise WrongUse("give a protocol and the folder for its session's folder, no session")

    @property
    def name(self) -> str:
        """The protocol, as people know it."""
        return Path(self.protocol or "").stem

    def request(self, start_utc: str) -> RunRequest:
        """Return the request of a run that starts now."""
        stamp = f"{datetime.fromisoformat(start_utc).astimezone(UTC):%Y%m%d-%H%M%S}"
        names = RunRequest.__struct_fields__
        fields = {name: getattr(self, name) for name in names}
        return RunRequest(**{**fields, "out": str(Path(self.out or "") / f"{self.name}-{stamp}")})


class RunQueue:
    """The runs that wait. ``problem``: why the first one did not start, empty for nothing."""

    def __init__(self) -> None:
        self.problem = ""
        self._numbers = count(1)
        self._entries: list[tuple[int, QueuedRun, tuple[int, int]]] = []
        """Number, request, and time and size of the protocol's file when it was added."""

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def names(self) -> str:
        """The protocols that wait, in their order."""
        return ", ".join(run.name for _, run, _ in self._entries)

    def add(self, run: QueuedRun) -> int:
        """Add a run behind the others; return its number. Raises WrongUse, ProtocolError."""
        if len(self) == MAX_ENTRIES:
            raise WrongUse(f"the queue has {MAX_ENTRIES} runs: remove one first")
        number = next(self._numbers)
        self._entries.append((number, run, _file_state(run)))
        return number

    def remove(self, number: int) -> None:
        """Remove a run. Raises WrongUse where there is none of this number."""
        del self._entries[self._place(number)]
        if not self._entries:
            self.problem = ""

    def move(self, number: int, places: int) -> None:
        """Move a run by places, backwards for a positive number. Raises WrongUse."""
        place = self._place(number)
        entry = self._entries.pop(place)
        self._entries.insert(max(0, place + places), entry)

    def start_first(self, start: Callable[[RunRequest], Started], start_utc: str) -> Started:
        """Start the first run, and remove it once it has begun; return it.

        Raises what ``start`` raises, and WrongUse without a run or where its protocol has changed.
        """
        if not self._entries:
            raise WrongUse("the queue is empty: add a run first")
        number, run, state = self._entries[0]
        if _file_state(run) != state:
            raise WrongUse(
                f"{run.protocol} has changed since it was queued: remove it and add it again"
            )
        started = start(run.request(start_utc))
        self.problem = ""
        self.remove(number)
        return started

    def status(self, run: RunStatus) -> QueueStatus:
        """Return the queue's part of the status; ``run``: that of the present run."""
        due_s = run.eta_s if run.is_active else None
        entries = []
        for number, each, _ in self._entries:
            shown = (each.name, each.seed, each.trials, each.plate_changes, each.duration_s)
            entries.append(QueuedRunStatus(number, *shown, due_s))
            due_s = None if due_s is None else due_s + each.duration_s
        return QueueStatus(tuple(entries), self._waits_for(run) if entries else "")

    def _waits_for(self, run: RunStatus) -> str:
        if run.state == "prompt":
            return "the present run waits for an answer"
        if run.state == "paused":
            reasons = reason_words(run.reasons)
            return f"the present run is paused{f' ({reasons})' if reasons else ''}"
        if run.is_active:
            return "the present run goes on"
        return self.problem or NOT_STARTED

    def _place(self, number: int) -> int:
        for place, (each, _, _) in enumerate(self._entries):
            if each == number:
                return place
        raise WrongUse(f"the queue has no run {number}: it has begun, or was removed")


def _file_state(run: QueuedRun) -> tuple[int, int]:
    """Return time in ns and size of a protocol's file. Raises ProtocolError, OSError."""
    state = find_protocol(run.protocol or "").stat()
    return state.st_mtime_ns, state.st_size
