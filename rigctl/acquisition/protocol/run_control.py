"""Who may hold or end a run, and how everything that waits learns of it.

A pause holds reasons; it ends when the last one is gone, and one reason's end does not lift
another's. Whatever waits for the rig calls :meth:`RunControl.check` at every turn of the poll loop
and is thrown out of its wait when there is a reason to hold or to end.
"""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.drum.poller import DrumPoller
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.rpc.messages import PromptStatus
from rigctl.errors import DiskFault, LinkLost, RigFault

OPERATOR, PROMPT, LINK, DISK, FAULT = "operator", "prompt", "link", "disk", "fault"
LINK_PATIENCE_S = 60.0


class RunPaused(Exception):
    """A reason to hold came up: lift, wait, begin the step anew."""


class RunStopped(Exception):
    """Somebody ended the run."""


class RunControl:
    """Reasons to hold, questions to people, and reasons to end.

    ``check_in`` tells the heartbeat that the run is alive; ``disk_failure`` what is wrong with
    the recorder, None when nothing is.
    """

    def __init__(
        self,
        watch: DrumPoller,
        news: EventBus,
        check_in: Callable[[], None],
        disk_failure: Callable[[], str | None],
    ) -> None:
        self.prompt: PromptStatus | None = None
        self.check_in = check_in
        self._watch = watch
        self._news = news
        self._disk_failure = disk_failure
        self._reasons: dict[str, float] = {}
        self._prompts = 0
        self._stop: str | None = None
        self._failure: RigFault | None = None

    @property
    def reasons(self) -> list[str]:
        """What the run waits for, in order of appearance."""
        asked = [PROMPT] if self.prompt is not None else []
        return [*self._reasons, *asked]

    def pause(self, reason: str = OPERATOR) -> None:
        """Hold for that reason until :meth:`resume` is called for it."""
        if reason not in self._reasons:
            self._reasons[reason] = self._watch.loop.time()
            self._news.tell("pause", f"the run holds: {reason}", reason=reason)

    def resume(self, reason: str = OPERATOR) -> None:
        """That reason is gone."""
        if self._reasons.pop(reason, None) is not None:
            self._news.tell("resume", f"no longer held: {reason}", reason=reason)

    @property
    def stopped(self) -> str | None:
        """Why somebody ended the run, None while nobody did."""
        return self._stop

    def abort(self, text: str) -> None:
        """End the run safely; what is committed stays."""
        self._stop = self._stop or text

    def fail(self, failure: RigFault) -> None:
        """End the run because of what somebody else found to be broken."""
        self._failure = self._failure or failure

    def answer(self, prompt_id: int, answer: str) -> bool:
        """Answer the question of that number; False where it is not the one that is asked."""
        if self.prompt is None or self.prompt.id != prompt_id:
            return False
        if answer == "abort":
            self.abort("stopped at a question")
        self.prompt = None
        return True

    def check(self) -> None:
        """Raise Stopped, RigFault or Paused where there is reason to."""
        self.check_in()
        self._check_ends()
        self._watch.healthy()
        if self._reasons:
            raise RunPaused(f"paused: {', '.join(self._reasons)}")

    async def turn(self) -> None:
        """Wait for the next turn of the poll loop, checking."""
        await self._watch.turn()
        self.check()

    async def wait(self, seconds: float) -> None:
        """Let loop time pass, checking."""
        end_s = self._watch.loop.time() + seconds
        while self._watch.loop.time() < end_s:
            await self.turn()

    async def hold(self) -> None:
        """Wait, with the rig already safe, until no reason is left and no fault latched."""
        while self._reasons:
            await self._held_turn()

    async def ask(self, text: str, texture: str | None) -> None:
        """Ask a person, with the rig already safe, and wait for the answer."""
        self._prompts += 1
        self.prompt = PromptStatus(id=self._prompts, text=text, texture=texture)
        self._news.tell("prompt", text, id=self._prompts, texture=texture)
        while self._is_asking():
            await self._held_turn()
        await self.hold()

    def _is_asking(self) -> bool:
        return self.prompt is not None

    async def _held_turn(self) -> None:
        """While people are at the rig an emergency stop is a reason to hold, not to end."""
        await self._watch.turn()
        self.check_in()
        self._check_ends()
        if self._watch.lost:
            raise LinkLost(self._watch.lost)
        if self._watch.fault_latched:
            self.pause(FAULT)
        else:
            self.resume(FAULT)

    def _check_ends(self) -> None:
        failure = self._disk_failure()
        if self._stop is not None:
            raise RunStopped(self._stop)
        if self._failure is not None:
            raise self._failure
        if failure is not None:
            raise DiskFault(failure)
        since_s = self._reasons.get(LINK)
        if since_s is not None and self._watch.loop.time() - since_s > LINK_PATIENCE_S:
            raise LinkLost(
                f"taxels: no connection for {LINK_PATIENCE_S:.0f} s: check the cable, "
                "then resume the session"
            )
