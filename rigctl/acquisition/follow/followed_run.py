"""What a session's events say about its run: whether it goes on, waits, asks or has ended."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.acquisition.protocol.pause_reasons import PROMPT
from rigctl.acquisition.rpc.messages import PromptStatus
from rigctl.session import layout
from rigctl.values import Event

_ENDED = {"finished": "done", "stopped": "aborted", "failed": "failed"}
_GOES_ON = ("trial", "turn", "approach", "baseline", "message", "instruction", "stage")
"""Kinds of events that follow the answer to a question: the record has no event of the answer."""


class FollowedRun:
    """Follows the events of one session of either experiment."""

    def __init__(self) -> None:
        self.prompt: PromptStatus | None = None
        self._reasons: list[str] = []
        self._outcome = ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """What the run waits for, in order of appearance."""
        return (*self._reasons, *((PROMPT,) if self.prompt else ()))

    @property
    def has_ended(self) -> bool:
        """Whether the event of the session's end was seen."""
        return bool(self._outcome)

    def update(self, events: Iterable[Event]) -> None:
        """Take new events, the oldest first."""
        for event in events:
            self._take(event)

    def state(self, *, has_ended: bool) -> str:
        """Return the state in the words of a run's status; ``has_ended``: the files are closed."""
        if has_ended:
            return _ENDED.get(self._outcome, "aborted")
        if self.prompt is not None:
            return "prompt"
        return "paused" if self._reasons else "running"

    def begin_part(self) -> None:
        """Take a part's begin: a run that goes on in a new part waits for nothing.

        A pause and a change of plates end the part, so the record has no event of their end.
        """
        self.prompt = None
        self._reasons.clear()

    def _take(self, event: Event) -> None:
        reason = str(event.data.get("reason"))
        if event.kind == "pause":
            self._reasons = [*filter(reason.__ne__, self._reasons), reason]
        elif event.kind == "resume":
            self._reasons = [*filter(reason.__ne__, self._reasons)]
        elif event.kind == "prompt":
            self.prompt = _prompt(event)
        elif event.kind == layout.SESSION_END_KIND:
            self._outcome = str(event.data.get("outcome"))
            self.prompt = None
            self._reasons.clear()
        elif event.kind in _GOES_ON:
            self.prompt = None


def _prompt(event: Event) -> PromptStatus:
    number, texture = event.data.get("id"), event.data.get("texture")
    known = number if isinstance(number, int) and not isinstance(number, bool) else 0
    return PromptStatus(known, event.text, texture if isinstance(texture, str) else None)
