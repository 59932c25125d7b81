"""What each step of a plan does on the rig; a step that was interrupted can be taken again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import singledispatchmethod
from typing import Any

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.health.boards import START, BoardFigures, BoardHealth
from rigctl.acquisition.protocol.progress import RunProgress
from rigctl.acquisition.protocol.run_control import RunControl, RunPaused, RunStopped
from rigctl.acquisition.protocol.trial_attempt import TrialAttempt, clock_ppm
from rigctl.acquisition.protocol.trial_quality import QualityLimits
from rigctl.acquisition.taxels.pipeline import SamplePipeline
from rigctl.errors import RigFault
from rigctl.protocol import (
    ApproachOnly,
    Baseline,
    ChangePlate,
    Message,
    Plan,
    Rest,
    RunTrial,
    Step,
    Tare,
    Turn,
)
from rigctl.session.format.header import CUT_BY_CLOCK
from rigctl.session.write.recorder import Recorder
from rigctl.values import PlannedTrial, Verdict

CLOCK_NEWS_PPM = 20.0


@dataclass(frozen=True, slots=True)
class RunParts:
    """What a run works with; ``set_plate`` says which plate is mounted from now on."""

    motion: DrumMotion
    pump: SamplePipeline
    news: EventBus
    recorder: Recorder
    control: RunControl
    health: BoardHealth
    set_plate: Callable[[str], object]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How the run answers by itself, and what earlier sittings left done.

    ``unasked``: plates change by themselves and nobody is there to be asked. ``done``: trials
    committed before; ``attempts``: how often each trial was tried before.
    """

    unasked: bool
    resumed: bool
    done: frozenset[int]
    attempts: dict[int, int]


class StepRunner:
    """Takes steps. What it may be called off by is in ``parts.control``."""

    def __init__(
        self, parts: RunParts, plan: Plan, options: RunOptions, progress: RunProgress
    ) -> None:
        self.current: PlannedTrial | None = None
        self.texture = ""
        self._parts = parts
        self._options = options
        self._progress = progress
        self._attempts = dict(options.attempts)
        self._quality = plan.protocol.quality
        self._limits = QualityLimits.of(plan.protocol.quality)
        self._part_reason = "resume" if options.resumed else "start"
        self._tared = False
        self._health_before: dict[str, BoardFigures] | None = None
        self._clocks_ppm = [float("inf"), float("inf")]

    async def take(self, step: Step) -> None:
        """Take one step. Raises Paused, Stopped and RigFault; the drum may be in contact then."""
        try:
            await self._perform(step)
        finally:
            self.current = None

    async def make_safe(self) -> None:
        """Lift, switch the drivers off and record no more, whatever there is to hold for."""
        motion = self._parts.motion
        checked, motion.check = motion.check, self._parts.control.check_in
        try:
            await motion.disarm()
        finally:
            motion.check = checked
            self._parts.pump.record_to(None)

    def record_health(self, when: str) -> None:
        """Have what the boards count of themselves stand in the session."""
        health = self._parts.health
        if self._health_before is None:
            self._health_before = health.figures()
        for event in health.events(when, self._health_before):
            self._parts.recorder.add_event(event)

    @singledispatchmethod
    async def _perform(self, step: Any) -> None:
        raise TypeError(f"no step of a plan: {step!r}")

    @_perform.register
    async def _(self, step: ChangePlate) -> None:
        if not self._options.unasked:
            await self.make_safe()
            await self._parts.control.ask(step.prompt, step.texture)
        self._parts.set_plate(step.texture)
        self.texture = step.texture
        self._tared = False
        self._parts.pump.record_to(None)
        self._part_reason = self._part_reason or "plate"

    @_perform.register
    async def _(self, step: RunTrial) -> None:
        trial = step.trial
        for _ in range(self._quality.attempts):
            self.current = trial
            await self._ready()
            if await self._attempt(trial):
                self._progress.commit(trial)
                return
            self._progress.rejected += 1
        self._progress.end(trial)
        text = f"trial {trial.trial_id} is given up after {self._quality.attempts} attempts"
        self._parts.news.tell("trial", text, trial_id=trial.trial_id)

    @_perform.register
    async def _(self, step: Tare) -> None:
        await self._ready()
        await self._parts.motion.tare()

    @_perform.register
    async def _(self, step: Rest) -> None:
        await self._ready()
        await self._parts.control.wait(step.seconds)

    @_perform.register
    async def _(self, step: Turn) -> None:
        await self._ready()
        told = {"speed_mm_s": step.speed_mm_s, "turns": step.turns}
        await self._parts.motion.move_to_quarter()
        what = f"{step.turns} turns at {step.speed_mm_s:g} mm/s, lifted,"
        self._parts.news.tell("turn", f"{what} begin", **told, begins=True)
        await self._parts.motion.turn(step.speed_mm_s, step.turns + 1)
        index = await self._parts.motion.index_error_steps()
        self._parts.news.tell("turn", f"{what} end", **told, begins=False, index_error_steps=index)

    @_perform.register
    async def _(self, step: Baseline) -> None:
        await self._ready()
        self._parts.news.tell("baseline", f"{step.seconds:g} s without contact begin")
        await self._parts.control.wait(step.seconds)
        self._parts.news.tell("baseline", "the time without contact ends")

    @_perform.register
    async def _(self, step: ApproachOnly) -> None:
        await self._ready()
        await self._parts.motion.set_press(step.force_g)
        await self._parts.motion.approach()
        self._parts.news.tell("approach", f"{step.force_g:g} g without travel begin")
        await self._parts.control.wait(step.seconds)
        self._parts.news.tell("approach", "the press ends")
        await self._lift()

    @_perform.register
    async def _(self, step: Message) -> None:
        self._parts.news.tell("message", step.text)
        if step.wait and not self._options.unasked:
            await self.make_safe()
            await self._parts.control.ask(step.text, None)

    async def _ready(self) -> None:
        """Recording, armed, homed and tared."""
        motion = self._parts.motion
        if not self._parts.pump.recording:
            self._parts.recorder.begin_part(self._part_reason or "goes on", self.texture)
            self._parts.pump.record_to(self._parts.recorder)
            self._part_reason = ""
            if self._health_before is None:
                self.record_health(START)
        await motion.arm()
        if not motion.homed:
            await motion.home()
        if not self._tared:
            await motion.tare()
            self._tared = True

    async def _attempt(self, trial: PlannedTrial) -> bool:
        """Take the trial once; True when it is committed. A row is stored whatever happens."""
        number = self._attempts.get(trial.trial_id, 0) + 1
        self._attempts[trial.trial_id] = number
        attempt = TrialAttempt(self._parts.motion, self._parts.pump, trial, number, self._limits)
        try:
            reasons = await attempt.run()
        except (RunPaused, RunStopped, RigFault) as end:
            self._store(attempt, Verdict.ABORTED, (str(end),))
            raise
        index = await self._parts.motion.index_error_steps()
        verdict = Verdict.REJECTED if reasons else Verdict.COMMITTED
        self._store(attempt, verdict, reasons, index_error_steps=index, **_cut_of(attempt))
        await self._lift()
        return not reasons

    async def _lift(self) -> None:
        """Finish the lift undisturbed: what is stored must not be taken again for a pause."""
        motion = self._parts.motion
        checked, motion.check = motion.check, self._parts.control.check_in
        try:
            await motion.lift()
        finally:
            motion.check = checked

    def _store(
        self, attempt: TrialAttempt, verdict: Verdict, reasons: tuple[str, ...], **more: float | str
    ) -> None:
        row = attempt.row(verdict, reasons)
        self._parts.recorder.commit_trial(row)
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._parts.news.tell(
            "trial",
            f"trial {row.trial.trial_id} {verdict}{why}",
            trial_id=row.trial.trial_id,
            attempt=row.attempt,
            verdict=str(verdict),
            reasons=list(reasons),
            **more,
        )
        self._tell_clocks()

    def _tell_clocks(self) -> None:
        """Both boards' clock errors, with the run's first trial and whenever they move."""
        estimates = (self._parts.motion.watch.clock.estimate, self._parts.pump.clock.estimate)
        told = [clock_ppm(estimate) for estimate in estimates]
        if (
            max(abs(new - old) for new, old in zip(told, self._clocks_ppm, strict=True))
            < CLOCK_NEWS_PPM
        ):
            return
        self._clocks_ppm = told
        self._parts.news.tell(
            "clock",
            f"clocks run fast: drum {told[0]:.0f} ppm, taxels {told[1]:.0f} ppm",
            drum_ppm=round(told[0], 1),
            taxels_ppm=round(told[1], 1),
        )


def _cut_of(attempt: TrialAttempt) -> dict[str, float | str]:
    """How far off the trial's first sample may be, where the sync line did not show it."""
    if attempt.place is None:
        return {}
    return {"cut_by": CUT_BY_CLOCK, "cut_uncertainty_ms": attempt.place.uncertainty_ms}


def steps_left(steps: Iterable[Step], done: frozenset[int]) -> Iterator[Step]:
    """The steps that are still to be taken when some trials are committed already.

    Plates are mounted only for steps that follow on them; free steps before the first trial
    that is left were taken in an earlier sitting, unless nothing was committed.
    """
    plate: ChangePlate | None = None
    begun = not done
    waiting: list[Step] = []
    for step in steps:
        if isinstance(step, ChangePlate):
            plate, waiting = step, []
        elif isinstance(step, RunTrial) and step.trial.trial_id in done:
            waiting = []
        elif begun or isinstance(step, RunTrial):
            begun = True
            yield from (s for s in (plate, *waiting) if s is not None)
            plate, waiting = None, []
            yield step
        else:
            waiting.append(step)
