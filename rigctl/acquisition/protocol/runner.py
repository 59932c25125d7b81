"""A protocol happening: its steps in order, with pauses, questions, repeats and a safe way out.

::

    running ─► done            every step taken, the session closed
     │   ▲
     ▼   │ last reason gone    lifted and switched off meanwhile; the interrupted step begins
    paused, prompt             anew, from the lifted drum
     │
     ├─► aborted               somebody stopped it
     └─► failed                the rig or the disk failed

Whatever way a run ends, the drum is lifted and the session is whole.
"""

from __future__ import annotations

from pathlib import Path

from rigctl.acquisition.health.boards import END
from rigctl.acquisition.protocol.progress import RunProgress
from rigctl.acquisition.protocol.run_control import RunPaused, RunStopped
from rigctl.acquisition.protocol.step_runner import RunOptions, RunParts, StepRunner, steps_left
from rigctl.acquisition.rpc.messages import CurrentTrial, RunStatus
from rigctl.errors import BoardFault, RigFault
from rigctl.protocol import Plan, Step
from rigctl.values import DrumState, Event, PlannedTrial
from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.states import State

SAFE_LIMIT_S = 20.0
CLEAR_TURNS = 3


class Run:
    """One sitting of one plan; steered through ``control``."""

    def __init__(self, parts: RunParts, plan: Plan, options: RunOptions) -> None:
        self.control = parts.control
        self.ending = ""
        self.text = ""
        self._parts = parts
        self._plan = plan
        self._options = options
        self._watch = parts.motion.watch
        self._now_s = parts.motion.watch.loop.time
        self._progress = RunProgress(plan.trials, options.done, plan.duration_s, self._now_s())
        self._performer = StepRunner(parts, plan, options, self._progress)

    @property
    def ended(self) -> bool:
        """Whether it is over and its session closed."""
        return bool(self.ending)

    @property
    def folder(self) -> Path:
        """The session's folder."""
        return self._parts.recorder.folder

    @property
    def complete(self) -> bool:
        """Whether every planned trial is committed."""
        return self._progress.committed == self._progress.planned

    async def execute(self) -> None:
        """Take the plan's steps; what a user can meet is not raised but told."""
        parts = self._parts
        unlisten = parts.news.listen(self._record)
        unwatch = self._watch.watch(self._record_drum)
        parts.motion.check = self.control.check
        try:
            ending, text = await self._take_steps()
            await self._make_safe()
        finally:
            parts.motion.check = lambda: None
            unwatch()
            unlisten()
            parts.pump.record_to(None)
            if parts.recorder.status.part == 0:
                parts.recorder.begin_part("nothing was recorded", "")
            self._performer.record_health(END)
            parts.recorder.close()
        self._end(ending, text)

    def status(self) -> RunStatus:
        """How it stands."""
        now_s, progress = self._now_s(), self._progress
        trial = self._performer.current
        return RunStatus(
            state=self._state(),
            text=self.text,
            reasons=() if self.ended else tuple(self.control.reasons),
            trial_id=trial.trial_id if trial else None,
            trials_planned=progress.planned,
            trials_committed=progress.committed,
            trials_rejected=progress.rejected,
            eta_s=None if self.ended else progress.eta_s(now_s),
            elapsed_s=progress.elapsed_s(now_s),
            current=_current(trial) if trial else None,
            prompt=None if self.ended else self.control.prompt,
            session=str(self.folder),
        )

    def _state(self) -> str:
        if self.ended:
            return self.ending
        if self.control.prompt is not None:
            return "prompt"
        return "paused" if self.control.reasons else "running"

    async def _take_steps(self) -> tuple[str, str]:
        """Last state of the run, and a sentence on it."""
        try:
            await self._clear_old_fault()
            await self._parts.motion.configure()
            await self._parts.motion.set_settle(self._plan.protocol.settle)
            for step in steps_left(self._plan.steps, self._options.done):
                await self._take(step)
        except RunStopped as stop:
            return "aborted", str(stop)
        except RigFault as fault:
            if self.control.stopped is not None:  # a stop overtook what the run was asking
                return "aborted", self.control.stopped
            self._parts.news.tell("fault", str(fault))
            return "failed", str(fault)
        missing = self._progress.planned - self._progress.committed
        if missing:
            return "done", f"{missing} trials could not be committed: see their reasons"
        return "done", "every trial is committed" if self._plan.trials else "every step is taken"

    async def _clear_old_fault(self) -> None:
        """Who starts a run has seen the rig: an old fault is cleared, if its cause is gone."""
        if not self._watch.fault_latched:
            return
        self._parts.news.tell("log", "a fault from before this run is cleared")
        await self._watch.drum.command(Command.CLEAR)
        for _ in range(CLEAR_TURNS):
            await self._watch.turn()
            self.control.check_in()

    async def _take(self, step: Step) -> None:
        """Take one step; after each pause, begin it anew."""
        while True:
            try:
                self.control.check()
                return await self._performer.take(step)
            except RunPaused:
                await self._hold()

    async def _hold(self) -> None:
        since_s = self._now_s()
        await self._performer.make_safe()
        await self.control.hold()
        self._progress.idle(self._now_s() - since_s)

    async def _make_safe(self) -> None:
        """Lift and switch off; where the board does it by itself, see that it does."""
        try:
            await self._performer.make_safe()
        except BoardFault:
            await self._await_fault_off()
        except RigFault as fault:
            self._parts.news.tell("fault", str(fault))

    async def _await_fault_off(self) -> None:
        end_s = self._now_s() + SAFE_LIMIT_S
        while self._now_s() < end_s and self._watch.connected:
            if self._watch.state is not None and self._watch.state.state == State.FAULT_OFF:
                return
            await self._watch.turn()
            self.control.check_in()

    def _end(self, ending: str, text: str) -> None:
        failure = self._parts.recorder.failure
        if failure is not None and ending == "done":
            ending, text = "failed", failure
        self.ending, self.text = ending, text
        folder = str(self.folder)
        self._parts.news.tell("run", text, state=ending, session=folder)

    def _record(self, event: Event) -> None:
        if self._parts.pump.recording:
            self._parts.recorder.add_event(event)

    def _record_drum(self, state: DrumState) -> None:
        if self._parts.pump.recording:
            settings = self._parts.motion.settings
            self._parts.recorder.add_drum(state, settings["force_set"], settings["speed_set"])


def _current(trial: PlannedTrial) -> CurrentTrial:
    return CurrentTrial(
        texture=trial.texture,
        speed_mm_s=trial.speed_mm_s,
        force_g=trial.force_g,
        repeat=trial.repeat,
    )
