"""How every wait of a run notices pauses, questions and the end.

All code that waits for the rig calls :meth:`RunControl.check` at every cycle of the poll loop,
which raises where there is a reason to pause or to end.
"""

from __future__ import annotations

from collections.abc import Callable

from rigctl.engine.event_bus import EventBus
from rigctl.engine.poller import DrumPoller
from rigctl.engine.rpc.messages import FAULT, LINK
from rigctl.engine.run_reasons import RunReasons, TrialSkipped
from rigctl.errors import LinkLost
from rigctl.session.recorder import Recorder

LINK_TIMEOUT_S = 60.0


class RunControl(RunReasons):
    """Reasons to pause or to end a run on the drum, checked at every poll.

    ``check_in`` reports to the heartbeat that the run is alive.
    """

    def __init__(
        self,
        poller: DrumPoller,
        event_bus: EventBus,
        recorder: Recorder,
        check_in: Callable[[], None],
    ) -> None:
        super().__init__(poller.loop.time, event_bus, lambda: recorder.failure)
        self.check_in = check_in
        self.skips_trial = False
        """Whether the trial in hand is left."""
        self._poller = poller

    def check(self) -> None:
        """Raise RunStopped, RigFault, TrialSkipped or RunPaused where there is a reason."""
        self.check_in()
        self.check_end()
        self._poller.healthy_state()
        if self.skips_trial:
            raise TrialSkipped("skipped by the operator")
        self.check_pause()

    def check_end(self) -> None:
        """Raise RunStopped or RigFault where there is a reason to end."""
        super().check_end()
        if self.paused_s(LINK) > LINK_TIMEOUT_S:
            raise LinkLost(
                f"a board was lost for {LINK_TIMEOUT_S:.0f} s: check its cable, "
                "then resume the session"
            )

    async def wait(self, seconds: float) -> None:
        """Wait in loop time, with a check at every poll."""
        end_s = self._poller.loop.time() + seconds
        while self._poller.loop.time() < end_s:
            await self._poller.wait_cycle()
            self.check()

    async def _wait_paused(self) -> None:
        """Wait for the next poll; a fault is now a reason to pause, as people are at the rig."""
        await self.wait_cycle()
        if self._poller.fault_latched and not self._poller.only_missed_beats:
            self.pause(FAULT)
        else:
            self.resume(FAULT)

    async def wait_cycle(self) -> None:
        """Wait for the next poll, also of a drum that is lost. Raises as :meth:`check_end`."""
        await self._poller.wait_cycle()
        self.check_in()
        self.check_end()
