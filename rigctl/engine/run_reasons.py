"""Reasons to pause or to end a run, and questions to the operator, without a rig.

A pause has reasons; it ends when the last one is gone, and the end of one reason does not remove
another.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from rigctl.engine.event_bus import EventBus
from rigctl.engine.rpc.messages import OPERATOR, PROMPT, PromptStatus, reason_words
from rigctl.errors import DiskFault, RigFault
from rigctl.session.layout import SessionOutcome

SESSION_OUTCOMES = {
    "done": SessionOutcome.FINISHED,
    "aborted": SessionOutcome.STOPPED,
    "failed": SessionOutcome.FAILED,
}
"""How a session ends, by the outcome of its run."""


class RunPaused(Exception):
    """A reason to pause: make the rig safe, wait, then repeat the step."""


class TrialSkipped(Exception):
    """A request to leave the trial in hand: make the rig safe, then go on with the next one."""


class RunStopped(Exception):
    """A request to end the run."""


class RunReasons(ABC):
    """Why a run waits or ends. ``disk_failure`` returns the recorder's failure, if any."""

    def __init__(
        self,
        now_s: Callable[[], float],
        event_bus: EventBus,
        disk_failure: Callable[[], str | None],
    ) -> None:
        self.prompt: PromptStatus | None = None
        self.abort_reason: str | None = None
        self._now_s = now_s
        self._event_bus = event_bus
        self._disk_failure = disk_failure
        self._paused_since_s: dict[str, float] = {}
        self._findings: list[str] = []
        self._prompt_count = 0
        self._failure: RigFault | None = None

    @property
    def reasons(self) -> tuple[str, ...]:
        """What the run waits for, in order of appearance."""
        return (*self._paused_since_s, *((PROMPT,) if self.prompt else ()))

    def pause(self, reason: str = OPERATOR) -> None:
        """Pause for this reason until :meth:`resume` is called for it."""
        if reason not in self._paused_since_s:
            self._paused_since_s[reason] = self._now_s()
            self._event_bus.publish(
                "pause", f"the run pauses: {reason_words((reason,))}", reason=reason
            )

    def pause_for(self, finding: str) -> None:
        """Pause for something that a person has to look at, until a person resumes the run."""
        self._findings.append(finding)
        self.pause(finding)

    def resume(self, reason: str = OPERATOR) -> None:
        """Remove this reason to pause; ``operator`` removes what a person had to look at, too."""
        while reason == OPERATOR and self._findings:
            self.resume(self._findings.pop())
        if self._paused_since_s.pop(reason, None) is not None:
            self._event_bus.publish(
                "resume", f"no longer paused: {reason_words((reason,))}", reason=reason
            )

    def abort(self, text: str) -> None:
        """End the run safely; committed trials stay."""
        self.abort_reason = self.abort_reason or text

    def fail(self, failure: RigFault) -> None:
        """End the run because another part of the engine failed."""
        self._failure = self._failure or failure

    def answer(self, prompt_id: int, answer: str) -> bool:
        """Answer the question with this number; return False where it is not the current one."""
        if self.prompt is None or self.prompt.id != prompt_id:
            return False
        if answer == "abort":
            self.abort("ended by whoever was asked")
        self.prompt = None
        return True

    def show_prompt(self, text: str, texture: str | None) -> None:
        """Ask the operator a question; :meth:`answer` removes it."""
        self._prompt_count += 1
        self.prompt = PromptStatus(self._prompt_count, text, texture)
        self._event_bus.publish("prompt", text, id=self._prompt_count, texture=texture)

    async def wait_resumed(self) -> None:
        """Wait, with the rig already safe, until no reason to pause is left."""
        while self._paused_since_s:
            await self._wait_paused()

    async def ask(self, text: str, texture: str | None) -> None:
        """Ask the operator, with the rig already safe, and wait for the answer."""
        self.show_prompt(text, texture)
        while PROMPT in self.reasons:
            await self._wait_paused()
        await self.wait_resumed()

    @abstractmethod
    async def _wait_paused(self) -> None:
        """Wait a moment of a pause or a question. Raises as :meth:`check_end`."""

    def check_end(self) -> None:
        """Raise RunStopped or RigFault where there is a reason to end."""
        disk_failure = self._disk_failure()
        self.check_stop()
        if self._failure is not None:
            raise self._failure
        if disk_failure is not None:
            raise DiskFault(disk_failure)

    def check_stop(self) -> None:
        """Raise RunStopped where somebody ended the run."""
        if self.abort_reason is not None:
            raise RunStopped(self.abort_reason)

    def check_pause(self) -> None:
        """Raise RunPaused where there is a reason to pause."""
        if self._paused_since_s:
            raise RunPaused(f"paused: {reason_words(self._paused_since_s)}")

    def paused_s(self, reason: str) -> float:
        """Return for how long the run has paused for a reason, 0 if it does not."""
        since_s = self._paused_since_s.get(reason)
        return 0.0 if since_s is None else self._now_s() - since_s
