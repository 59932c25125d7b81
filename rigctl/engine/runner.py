"""A run of a protocol: its steps in order, with pauses, questions, repeats and a safe end.

::

    running ─► done            every step run, the session closed
     │   ▲
     ▼   │ last reason gone    lifted and switched off meanwhile; then the interrupted step
    paused, prompt             repeats, from the lifted drum
     │
     ├─► aborted               stopped by a person or a client
     └─► failed                the rig or the disk failed

A drum that stopped because it did not hear the computer is brought back a few times in a row; what
else stopped it ends the run (docs/explanation/safety.md). However a run ends, the drum is lifted
and the session is complete.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

from msgspec.structs import asdict

from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State
from rigctl.engine.early_end import checked_rule
from rigctl.engine.event_bus import EventBus
from rigctl.engine.health import END
from rigctl.engine.progress import RunProgress
from rigctl.engine.rig_boards import RigBoards
from rigctl.engine.rpc.messages import CurrentTrial, NextPlate, RunStatus
from rigctl.engine.run_control import RunControl
from rigctl.engine.run_reasons import RunPaused, RunStopped, TrialSkipped
from rigctl.engine.run_request import OpenedRun
from rigctl.engine.run_steps import RunSteps
from rigctl.engine.served_run import ServedRun
from rigctl.engine.settings import settle_settings
from rigctl.engine.step_runner import StepRunner, remaining_steps
from rigctl.errors import BoardFault, DiskFault, LinkLost, RigFault, WrongUse
from rigctl.protocol.plan import condition_of
from rigctl.protocol.steps import RunTrial, Step
from rigctl.session.notes import Mark, SessionNote
from rigctl.session.recorder import Recorder
from rigctl.session.session import EARLY_END_KIND, ConditionEnd
from rigctl.values import DrumState, Event, PlannedTrial

SAFE_TIMEOUT_S = 20.0
RECOVERIES = 3
"""How often in one step a drum that did not hear the computer is brought back."""
CLEAR_CYCLES = 3
DISK_CYCLES = 100
"""Cycles of the poll loop between two tries of a disk that refused: 5 s."""


class Run(ServedRun[RunControl, Recorder]):
    """One sitting of one plan on the drum."""

    def __init__(
        self,
        boards: RigBoards,
        event_bus: EventBus,
        opened: OpenedRun,
        check_in: Callable[[], None],
        set_plate: Callable[[str], object],
    ) -> None:
        plan, recorder = opened.plan, opened.recorder
        control = RunControl(boards.drum_poller, event_bus, recorder, check_in)
        super().__init__(control, recorder, event_bus, opened.missing)
        self._opened = opened
        self._motion = boards.motion
        self._pipeline = boards.pipeline
        self._poller = boards.drum_poller
        self._now_s = boards.drum_poller.loop.time
        self._progress = RunProgress(
            plan.trials, opened.done, plan.duration_s, self._now_s, opened.ended
        )
        self._steps = RunSteps(remaining_steps(plan.steps, opened.done | opened.ended))
        self._step_runner = StepRunner(
            boards, event_bus.publish, opened, self.control, self._progress, set_plate
        )
        self._left_out = set(opened.ended)
        self._in_hand: PlannedTrial | None = None

    @property
    def complete(self) -> bool:
        """Whether every planned trial is committed, or was left out by an early end."""
        return self._progress.missing == 0

    @contextmanager
    def _recording(self) -> Iterator[None]:
        unsubscribe_events = self._event_bus.subscribe(self._record_event)
        unsubscribe_states = self._poller.subscribe(self._record_drum)
        self._motion.check = self.control.check
        try:
            yield
        finally:
            self._motion.check = lambda: None
            unsubscribe_states()
            unsubscribe_events()
            self._pipeline.set_recorder(None)

    def _record_end(self) -> None:
        self._step_runner.record_health(END)

    def status(self) -> RunStatus:
        """Return the run's part of the status message."""
        progress, trial = self._progress, self._step_runner.current
        return RunStatus(
            state=self.state,
            text=self.text,
            reasons=() if self.ended else self.control.reasons,
            trial_id=trial.trial_id if trial else None,
            trials_planned=progress.planned,
            trials_committed=progress.committed,
            trials_rejected=progress.rejected,
            trials_ended_early=progress.ended_early,
            eta_s=None if self.ended else progress.eta_s(),
            elapsed_s=progress.clock.elapsed_s,
            trial_age_s=progress.trial_age_s(),
            next_plate=None if self.ended else self._next_plate(),
            current=_current_trial(trial) if trial else None,
            prompt=None if self.ended else self.control.prompt,
            session=str(self.folder),
        )

    def add_note(self, note: SessionNote) -> None:
        """Write a note beside the session's parts."""
        self._recorder.add_note(replace(note, author=self._recorder.header.operator))
        self._event_bus.publish("note", note.describe(), trial_id=note.trial_id, mark=note.mark)

    def repeat(self, trial_id: int, note: SessionNote) -> None:
        """Run a trial once more while its plate is on; ``note`` marks the attempt that counted.

        Raises WrongUse for a trial that the run cannot repeat.
        """
        trials = self._opened.plan.trials
        if not 1 <= trial_id <= len(trials):
            raise WrongUse(f"the plan has no trial {trial_id}: its trials are 1 to {len(trials)}")
        if trial_id in self._left_out:
            raise WrongUse(f"trial {trial_id} is left out: its condition ended early")
        trial = trials[trial_id - 1]
        attempt = self._step_runner.committed_attempt(trial_id)
        if self._step_runner.current == trial and not attempt:
            raise WrongUse(f"trial {trial_id} is being recorded: wait for its end")
        self._steps.repeat(trial)
        self._step_runner.reopen(trial_id)
        if attempt:
            self.add_note(replace(note, trial_id=trial_id, attempt=attempt, mark=Mark.BAD))
        self._progress.reopen(trial, was_committed=bool(attempt))

    def skip(self, trial_id: int) -> None:
        """Leave out a trial that is to come, or the one in hand; 0 is the one in hand or the next.

        The rest of the plan is recorded, and a continued session has the trial again. Raises
        WrongUse for a trial that is recorded already, or not of the plan.
        """
        to_come = self._steps.trials()
        choice = [trial for trial in (self._in_hand, *to_come) if trial is not None]
        found = [trial for trial in choice if trial_id in (0, trial.trial_id)]
        if not found or self._step_runner.committed_attempt(found[0].trial_id):
            raise WrongUse(f"trial {trial_id or 'none'} is not to come: there is nothing to skip")
        trial = found[0]
        text = f"trial {trial.trial_id} is skipped"
        self._event_bus.publish("trial", text, trial_id=trial.trial_id)
        if trial == self._in_hand:
            self.control.skips_trial = True
        else:
            self._steps.drop([trial])
            self._progress.skip(trial, was_in_hand=False)

    def end_condition(self, end: ConditionEnd) -> bool:
        """Leave out the trials of a condition that are to come; none are left is no error.

        Returns False while the event could not be recorded. Raises WrongUse where the protocol's
        rule does not allow it.
        """
        if not self._pipeline.is_recording:
            return False
        rule = checked_rule(end, self._opened.plan, self._step_runner.committed_attempt)
        left_out = [t for t in self._steps.trials() if condition_of(t) == end.condition]
        if left_out:
            self._steps.drop(left_out)
            self._progress.end_early(left_out)
            self._left_out.update(trial.trial_id for trial in left_out)
            self._event_bus.publish(EARLY_END_KIND, end.describe(rule), **asdict(end))
        return True

    def _next_plate(self) -> NextPlate | None:
        texture, trials = self._steps.next_plate, self._steps.trials_on_plate()
        if texture is None:
            return None
        n_more = len(trials)
        present = self._in_hand  # in a pause, too: its trial begins again
        if present and not self._step_runner.committed_attempt(present.trial_id):
            trials = [present, *trials]
        left_s = self._progress.duration_of_s(trials)
        return NextPlate(texture, n_more, left_s)

    async def _run_plan(self) -> tuple[str, str]:
        outcome = await self._run_steps()
        await self._make_safe()
        return outcome

    async def _run_steps(self) -> tuple[str, str]:
        """Return the outcome and a sentence on it."""
        try:
            if self._poller.fault_latched:  # the operator saw the rig
                self._event_bus.publish("log", "a fault from before this run is cleared")
                await self._clear_fault()
            await self._configure()
            while True:
                for step in self._steps:
                    await self._run_step(step)
                if await self._reached_disk():
                    break
        except RunStopped as stop:
            return "aborted", str(stop)
        except RigFault as fault:
            if self.control.abort_reason is not None:  # a stop interrupted the run's request
                return "aborted", self.control.abort_reason
            self._event_bus.publish("fault", str(fault))
            return "failed", str(fault)
        missing, early = self._progress.missing, self._progress.ended_early
        if not missing and early:
            return "done", f"every condition is recorded; {early} trials were left out: early end"
        if missing:
            return "done", f"{missing} trials could not be committed: see their reasons"
        return (
            "done",
            "every trial is committed" if self._opened.plan.trials else "every step is done",
        )

    async def _clear_fault(self) -> None:
        """Clear the latched fault. Raises CommandRefused while its cause is present."""
        await self._poller.drum.command(Command.CLEAR)
        for _ in range(CLEAR_CYCLES):
            await self.control.wait_cycle()

    async def _configure(self) -> None:
        await self._motion.configure()
        await self._motion.write_settings(**settle_settings(self._opened.plan.protocol.settle))

    async def _run_step(self, step: Step) -> None:
        """Run one step; repeat it where the drum stopped because it did not hear the computer."""
        trouble = RigFault("no step was tried")
        for number in range(RECOVERIES + 1):
            try:
                if number and not await self._recover(trouble, number):
                    break
                return await self._repeat_after_pauses(step)
            except RigFault as fault:
                trouble = fault
        raise trouble

    async def _recover(self, trouble: RigFault, number: int) -> bool:
        """Bring the drum back where only silence stopped it; return False where something else did.

        Raises BoardFault for a fault that came meanwhile, LinkLost and what ends the run.
        """
        if self._recorder.may_try_again:
            await self._wait_for_disk()
            return True
        self.control.check_end()
        # A board that restarted counts anew, in a new part.
        self._pipeline.set_recorder(None)
        with self._progress.idle():
            while not self._poller.connected:
                await self.control.wait_cycle()
            await self._motion.wait_started()
            await self._make_safe()
            missed_beats = self._poller.only_missed_beats
            if not missed_beats:
                self._poller.healthy_state()
                if not isinstance(trouble, LinkLost):
                    return False
            what = "the missed heartbeat is cleared" if missed_beats else "the drum is back"
            text = f"{what}, and the step begins again: {number} of at most {RECOVERIES} times"
            self._event_bus.publish("recovery", text, number=number, after=str(trouble))
            if missed_beats:
                await self._clear_fault()
            self._motion.homed = False
            await self._configure()
        return True

    async def _reached_disk(self) -> bool:
        """Wait until all is written; return False where trials are to be recorded again.

        Raises DiskFault where the recorder failed for good.
        """
        await self._make_safe()
        try:
            self._recorder.wait_written()
        except DiskFault:
            if not self._recorder.may_try_again:
                raise
            await self._wait_for_disk()
        return not self._steps.trials()

    async def _wait_for_disk(self) -> None:
        """Pause until the disk takes files again; record again what did not reach it.

        Raises RunStopped.
        """
        with self._progress.idle():
            await self._make_safe()
            on_disk = await self._until_disk_works(self._wait_to_try_again)
        for trial_id in self._step_runner.committed_ids - on_disk:
            trial = self._opened.plan.trials[trial_id - 1]
            self._step_runner.reopen(trial_id)
            self._progress.reopen(trial, was_committed=True)
            with suppress(WrongUse):  # of the plate before: a continued session records it again
                self._steps.repeat(trial)

    async def _wait_to_try_again(self) -> None:
        for _ in range(DISK_CYCLES):
            await self._poller.wait_cycle()
            self.control.check_in()
            self.control.check_stop()

    async def _repeat_after_pauses(self, step: Step) -> None:
        self.control.skips_trial = False
        self._in_hand = step.trial if isinstance(step, RunTrial) else None
        while True:
            try:
                self.control.check()
                return await self._step_runner.run_step(step)
            except TrialSkipped:
                return await self._leave_trial()
            except RunPaused:
                await self._pause()

    async def _leave_trial(self) -> None:
        assert self._in_hand is not None
        self.control.skips_trial = False
        await self._step_runner.make_safe()
        self._progress.skip(self._in_hand, was_in_hand=True)

    async def _pause(self) -> None:
        with self._progress.idle():
            await self._step_runner.make_safe()
            await self.control.wait_resumed()

    async def _make_safe(self) -> None:
        """Lift and switch off; where the board does so for a fault, wait for it."""
        try:
            await self._step_runner.make_safe()
        except BoardFault:
            await self._wait_for_fault_off()
        except RigFault as fault:
            self._event_bus.publish("fault", str(fault))

    async def _wait_for_fault_off(self) -> None:
        end_s = self._now_s() + SAFE_TIMEOUT_S
        while self._now_s() < end_s and self._poller.connected:
            if self._poller.state is not None and self._poller.state.state == State.FAULT_OFF:
                return
            await self._poller.wait_cycle()
            self.control.check_in()

    def _record_event(self, event: Event) -> None:
        """Record an event, also one of a pause, once there is a part for it."""
        if self._step_runner.has_recorded:
            self._recorder.add_event(event)

    def _record_drum(self, state: DrumState) -> None:
        if self._pipeline.is_recording:
            settings = self._motion.settings  # not known yet of a board that is just back
            set_points = settings.get("force_set", 0.0), settings.get("speed_set", 0.0)
            self._recorder.add_drum(state, *set_points)


def _current_trial(trial: PlannedTrial) -> CurrentTrial:
    return CurrentTrial(trial.texture, trial.speed_mm_s, trial.force_g, trial.repeat, trial.mount)
