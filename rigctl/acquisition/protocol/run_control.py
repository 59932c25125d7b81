"""Pauses, questions and the end of a run, and how every wait notices them.

A pause has reasons; it ends when the last one is gone, and the end of one reason does not remove
another. All code that waits for the rig calls :meth:`RunControl.check` at every cycle of the poll
loop, which raises where there is a reason to pause or to end.
"""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.drum.poller import DrumPoller
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.rpc.messages import PromptStatus
from rigctl.errors import DiskFault, LinkLost, RigFault
from rigctl.session.write.recorder import Recorder

OPERATOR, PROMPT, LINK, DISK, FAULT = "operator", "prompt", "link", "disk", "fault"
LINK_TIMEOUT_S = 60.0


class RunPaused(Exception):
    """A reason to pause: lift, wait, then repeat the step."""


class RunStopped(Exception):
    """A request to end the run."""


class RunControl:
    """Reasons to pause, questions to the operator, and reasons to end.

    ``check_in`` reports to the heartbeat that the run is alive.
    """

    def __init__(
        self,
        poller: DrumPoller,
        event_bus: EventBus,
        recorder: Recorder,
        check_in: Callable[[], None],
    ) -> None:
        self.prompt: PromptStatus | None = None
        self.check_in = check_in
        self.abort_reason: str | None = None
        self._poller = poller
        self._event_bus = event_bus
        self._recorder = recorder
        self._paused_since_s: dict[str, float] = {}
        self._prompt_count = 0
        self._failure: RigFault | None = None

    @property
    def reasons(self) -> tuple[str, ...]:
        """What the run waits for, in order of appearance."""
        return (*self._paused_since_s, *((PROMPT,) if self.prompt else ()))

    def pause(self, reason: str = OPERATOR) -> None:
        """Pause for this reason until :meth:`resume` is called for it."""
        if reason not in self._paused_since_s:
            self._paused_since_s[reason] = self._poller.loop.time()
            self._event_bus.publish("pause", f"the run pauses: {reason}", reason=reason)

    def resume(self, reason: str = OPERATOR) -> None:
        """Remove this reason to pause."""
        if self._paused_since_s.pop(reason, None) is not None:
            self._event_bus.publish("resume", f"no longer paused: {reason}", reason=reason)

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
            self.abort("stopped at a question")
        self.prompt = None
        return True

    def check(self) -> None:
        """Raise RunStopped, RigFault or RunPaused where there is a reason."""
        self.check_in()
        self._check_end()
        self._poller.healthy_state()
        if self._paused_since_s:
            raise RunPaused(f"paused: {', '.join(self._paused_since_s)}")

    async def wait(self, seconds: float) -> None:
        """Wait in loop time, with a check at every poll."""
        end_s = self._poller.loop.time() + seconds
        while self._poller.loop.time() < end_s:
            await self._poller.wait_cycle()
            self.check()

    async def wait_resumed(self) -> None:
        """Wait, with the rig already safe, until no reason is left and no fault is latched."""
        while self._paused_since_s:
            await self._wait_paused_cycle()

    async def ask(self, text: str, texture: str | None) -> None:
        """Ask the operator, with the rig already safe, and wait for the answer."""
        self._prompt_count += 1
        self.prompt = PromptStatus(self._prompt_count, text, texture)
        self._event_bus.publish("prompt", text, id=self._prompt_count, texture=texture)
        while PROMPT in self.reasons:
            await self._wait_paused_cycle()
        await self.wait_resumed()

    async def _wait_paused_cycle(self) -> None:
        """Wait for the next poll; a fault is now a reason to pause, as people are at the rig."""
        await self._poller.wait_cycle()
        self.check_in()
        self._check_end()
        if self._poller.link_error:
            raise LinkLost(self._poller.link_error)
        if self._poller.fault_latched:
            self.pause(FAULT)
        else:
            self.resume(FAULT)

    def _check_end(self) -> None:
        disk_failure = self._recorder.failure
        if self.abort_reason is not None:
            raise RunStopped(self.abort_reason)
        if self._failure is not None:
            raise self._failure
        if disk_failure is not None:
            raise DiskFault(disk_failure)
        since_s = self._paused_since_s.get(LINK)
        if since_s is not None and self._poller.loop.time() - since_s > LINK_TIMEOUT_S:
            raise LinkLost(
                f"taxels: no connection for {LINK_TIMEOUT_S:.0f} s: check the cable, "
                "then resume the session"
            )
