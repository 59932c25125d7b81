"""The steps of a plan on the rig, and a trial attempt."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.boards import drum_registers, taxel_frames
from rigctl.boards.clock_fit import ClockEstimate, ClockFit
from rigctl.boards.drum_codes import Status
from rigctl.engine.contact import has_status
from rigctl.engine.health import START, Counters
from rigctl.engine.motion import DrumMotion
from rigctl.engine.pipeline import SamplePipeline
from rigctl.engine.progress import RunProgress
from rigctl.engine.rig_boards import RigBoards
from rigctl.engine.run_control import RunControl
from rigctl.engine.run_reasons import RunPaused, RunStopped, TrialSkipped
from rigctl.engine.run_request import OpenedRun
from rigctl.engine.settings import press_settings, trial_settings
from rigctl.engine.trial_cutter import CutTrial
from rigctl.engine.trial_quality import (
    FailedAttempt,
    MeasuredTrial,
    diagnose,
    judge,
    measure,
    trial_row,
)
from rigctl.errors import RigFault
from rigctl.protocol.plan import EACH_TRIAL, Protocol, condition_of
from rigctl.protocol.steps import (
    ApproachOnly,
    Baseline,
    ChangePlate,
    Message,
    Rest,
    RunTrial,
    Step,
    Tare,
    Turn,
)
from rigctl.session.data_quality import DataVerdict, TrialHistory, cell_statistics
from rigctl.session.header import CUT_BY_CLOCK
from rigctl.session.session_reader import QUARANTINE_KIND
from rigctl.values import SAMPLE_RATE_HZ, DrumState, LoadcellSample, PlannedTrial, TrialRow, Verdict

CABLE_S = 0.004
"""Delay that one USB adapter may add and the other may not; no clock shows it."""
SAMPLE_S = 1.0 / SAMPLE_RATE_HZ
_BITS_PER_BYTE = 10
_REPLY_BYTES = 2 * drum_registers.POLL_BLOCK[1] + 5
POLL_WIRE_S = _REPLY_BYTES * _BITS_PER_BYTE / drum_registers.BAUD
"""From the drum's reading of its clock to the last byte of the reply that holds it."""


def frame_wire_s(n_taxels: int) -> float:
    """Return the time from the start of a frame's first reading to the frame's last byte."""
    return SAMPLE_S + taxel_frames.frame_bytes(n_taxels) * _BITS_PER_BYTE / taxel_frames.BAUD


class TrialStart(NamedTuple):
    """Board counter of the first sample after the rise, and its uncertainty in ms."""

    first_counter: int
    uncertainty_ms: float


def estimate_trial_start(
    rise_us: int, drum: ClockFit, taxels: ClockFit, n_taxels: int
) -> TrialStart | None:
    """Return the first taxel sample after the drum's window opened at ``rise_us`` of its clock.

    ``taxels`` pairs sample counters, in seconds of 1000 samples, with the arrivals of frames of
    ``n_taxels``. None where either clock is not known yet.
    """
    drum_line, taxel_line = drum.earliest_arrivals, taxels.earliest_arrivals
    if drum_line is None or taxel_line is None:
        return None
    rise_s = drum_line.loop_s(rise_us * 1e-6) - POLL_WIRE_S
    counter_s = taxel_line.board_s(rise_s + frame_wire_s(n_taxels))
    spread_s = drum_line.spread_s + taxel_line.spread_s
    uncertainty_ms = 1000 * (SAMPLE_S + CABLE_S + spread_s)
    return TrialStart(math.ceil(counter_s / SAMPLE_S), round(uncertainty_ms, 2))


LATE_SAMPLES_TIMEOUT_S = 1.0
MAX_CLOCK_ERROR_PPM = 100.0
MIN_CLOCK_SPAN_S = 5.0
CLOCK_TIMEOUT_S = 30.0
LEAST_READINGS = 8
"""Of the lifted load cell, whose median says how far it has drifted."""


class TrialAttempt:
    """Moves, presses, runs, cuts and judges one trial. Use once; :meth:`row` is always valid."""

    def __init__(
        self,
        motion: DrumMotion,
        pipeline: SamplePipeline,
        trial: PlannedTrial,
        number: int,
        protocol: Protocol,
    ) -> None:
        self.trial = trial
        self.number = number
        self.drift_g = 0.0
        """What the lifted load cell read where it was tared for it, else 0."""
        self.start_by_clock: TrialStart | None = None
        self._motion = motion
        self._poller = motion.poller
        self._pipeline = pipeline
        self._protocol = protocol
        self._now_s = motion.poller.loop.time
        self._started_s = self._now_s()
        self._loadcell: list[LoadcellSample] = []
        self._measured = MeasuredTrial()
        self._cut: CutTrial | None = None
        self._baseline: NDArray[np.float64] | None = None
        self._by_wire = motion.config.signals.sync
        self._rises_before: int | None = None

    async def run(self, *, in_contact: bool) -> tuple[str, ...]:
        """Record the trial and return the reasons against it, none if it is good.

        ``in_contact``: from the trial before. Begins the lift, unless the protocol lifts by
        condition. Raises what ``motion.check`` raises, and RigFault.
        """
        unsubscribe = self._poller.subscribe(self._add_state)
        try:
            await (self._turn_on() if in_contact else self._press())
            await self._pass_window()
        finally:
            unsubscribe()
            self._pipeline.flush()
            self._cut = self._pipeline.trial_cutter.trial
            self._baseline = self._pipeline.trial_cutter.baseline
            self._pipeline.trial_cutter.cancel()
        return judge(self.trial, self._cut, self._measured, self._protocol.quality)

    def judged_by(self, history: TrialHistory) -> DataVerdict:
        """Return what a history of equal trials finds in the trial's data."""
        if self._cut is None or self._cut.sums is None:
            return DataVerdict()
        cell = cell_statistics(self._measured.forces_g)
        statistics = self._cut.sums.statistics(self._baseline, cell)
        return history.judge(condition_of(self.trial), statistics)

    def row(self, verdict: Verdict, reasons: tuple[str, ...]) -> TrialRow:
        """Return the attempt's row; the recorder fills in part and first sample."""
        times_s = self._started_s, self._now_s()
        return trial_row(
            self.trial, self.number, verdict, reasons, self._cut, self._measured, *times_s
        )

    async def _press(self) -> None:
        motion = self._motion
        await motion.write_settings(**trial_settings(self.trial, motion.config.drum))
        await motion.move_to_start(self.trial)
        if self._protocol.drift_limit_g < math.inf:
            await self._tare_drift()
        self._pipeline.flush()
        self._pipeline.trial_cutter.expect(self.trial.n_samples, self._by_wire)
        await motion.approach()

    async def _tare_drift(self) -> None:
        """Tare where the readings since the lift, or some more, ask for it."""
        while len(self._loadcell) < LEAST_READINGS:
            await self._poller.wait_cycle()
            self._motion.check()
        lifted_g = float(np.median([sample.force_g for sample in self._loadcell]))
        if abs(lifted_g) >= self._protocol.drift_limit_g:
            self.drift_g = lifted_g
            await self._motion.tare()

    async def _turn_on(self) -> None:
        motion = self._motion
        await motion.wait_holding()
        await motion.write_settings(**trial_settings(self.trial, motion.config.drum))
        await motion.begin_run_in_here(self.trial)
        self._pipeline.flush()
        cutter = self._pipeline.trial_cutter
        cutter.expect(self.trial.n_samples, self._by_wire, is_lifted=False)

    async def _pass_window(self) -> None:
        motion = self._motion
        await self._wait_for_clocks()
        await motion.trim_clock()
        self._rises_before = rises_before = self._poller.healthy_state().sync_count
        state = await motion.pass_window()
        if self._protocol.lift == EACH_TRIAL:
            await motion.begin_lift()
        if state.sync_count == rises_before:
            raise RigFault("the drum ran without raising its sync line: load its firmware again")
        self._measured = measure(
            self.trial,
            state,
            self._loadcell,
            motion.settings["travel_set"],
            self._poller.clock_fit.ppm or 0.0,
        )
        await self._wait_for_samples()

    async def _wait_for_clocks(self) -> None:
        """Wait until the clock errors are known well enough for a true speed and a cut."""
        end_s = self._now_s() + CLOCK_TIMEOUT_S
        fits = {"drum": self._poller.clock_fit}
        if not self._by_wire:
            fits["taxel board"] = self._pipeline.clock_fit
        while unknown := [board for board, fit in fits.items() if not _is_known(fit.estimate)]:
            if self._now_s() > end_s:
                raise RigFault(
                    f"the {unknown[0]}'s clock cannot be fitted because its data arrive too "
                    "unevenly: give the board a USB port of its own"
                )
            await self._poller.wait_cycle()
            self._motion.check()

    async def _wait_for_samples(self) -> None:
        """Give the window's last samples time to arrive; lost ones are judged, not awaited."""
        end_s = self._now_s() + LATE_SAMPLES_TIMEOUT_S
        while not self._is_cut() and self._now_s() < end_s:
            await self._poller.wait_cycle()
            self._motion.check()

    def _is_cut(self) -> bool:
        self._pipeline.flush()
        cut = self._pipeline.trial_cutter.trial
        return cut is not None and cut.complete

    def _add_state(self, state: DrumState) -> None:
        self._loadcell.extend(state.loadcell)
        rose = self._rises_before is not None and state.sync_count != self._rises_before
        if rose and not self._by_wire and self.start_by_clock is None:
            self._cut_by_clock(state)

    def _cut_by_clock(self, state: DrumState) -> None:
        """Cut at the rise's time on the drum: no wire shows it to the taxel board."""
        self._pipeline.flush()
        self.start_by_clock = estimate_trial_start(
            state.sync_rise_us,
            self._poller.clock_fit,
            self._pipeline.clock_fit,
            self._motion.config.taxels.count,
        )
        if self.start_by_clock is not None:
            self._pipeline.trial_cutter.begin(self.start_by_clock.first_counter)


def _is_known(estimate: ClockEstimate | None) -> bool:
    return (
        estimate is not None
        and estimate.span_s >= MIN_CLOCK_SPAN_S
        and estimate.error_ppm <= MAX_CLOCK_ERROR_PPM
    )


CLOCK_EVENT_PPM = 20.0
"""A clock error that changes by this much is published again."""


class StepRunner:
    """Runs steps. ``control`` may interrupt them; ``set_plate`` reports the mounted plate."""

    def __init__(
        self,
        boards: RigBoards,
        publish: Callable[..., None],
        opened: OpenedRun,
        control: RunControl,
        progress: RunProgress,
        set_plate: Callable[[str], object],
    ) -> None:
        self.current: PlannedTrial | None = None
        self._texture = ""
        self._health = boards.board_health
        self._motion = boards.motion
        self._pipeline = boards.pipeline
        self._publish = publish
        self._recorder = opened.recorder
        self._control = control
        self._progress = progress
        self._set_plate = set_plate
        self._unattended = opened.unattended
        self._attempts = Counter(opened.attempts)
        self._committed = {trial: opened.attempts[trial] for trial in opened.done}
        self._protocol = opened.plan.protocol
        self._quality = opened.plan.protocol.quality
        self._pressed: RunTrial | None = None
        """The trial from which the drum is still in contact."""
        self._history = TrialHistory(self._quality)
        self._failures: list[FailedAttempt] = []
        self._part_reason = "resume" if opened.resumed else "start"
        self._tared = False
        self._run_in = {"run_in_set": boards.motion.config.drum.run_in_mm}
        """Of a trial that begins with an approach."""
        self._start_counters: dict[str, Counters] | None = None
        self._clocks_ppm = [float("inf"), float("inf")]

    async def run_step(self, step: Step) -> None:
        """Run one step. Raises what ``control`` raises and RigFault, also while in contact."""
        try:
            if self._protocol.way_between_mm(self._pressed, step) is None:
                await self._leave_contact()
            match step:
                case ChangePlate():
                    await self._change_plate(step)
                case RunTrial():
                    await self._run_trial(step.trial)
                case Message():
                    await self._show_message(step)
                case _:
                    await self._prepare()
                    await self._run_free_step(step)
        finally:
            self.current = None

    async def make_safe(self) -> None:
        """Lift, switch the drivers off and stop recording, regardless of reasons to pause."""
        self._pressed = None
        try:
            await self._without_pauses(self._motion.disarm)
            await self._motion.write_settings(**self._run_in)
        finally:
            self._pipeline.set_recorder(None)

    def record_health(self, when: str) -> None:
        """Write the boards' health counters to the session."""
        if self._start_counters is None:
            self._start_counters = self._health.counters()
        for event in self._health.events(when, self._start_counters):
            self._recorder.add_event(event)

    @property
    def has_recorded(self) -> bool:
        """Whether this sitting has begun a part."""
        return self._start_counters is not None

    @property
    def committed_ids(self) -> frozenset[int]:
        """Numbers of the trials that count as committed."""
        return frozenset(self._committed)

    def committed_attempt(self, trial_id: int) -> int:
        """Return the number of the attempt at a trial that counts, 0 for none."""
        return self._committed.get(trial_id, 0)

    def reopen(self, trial_id: int) -> None:
        """Let no attempt at a trial count any longer."""
        self._committed.pop(trial_id, None)

    async def _run_free_step(self, step: Tare | Rest | Turn | Baseline | ApproachOnly) -> None:
        match step:
            case Tare():
                await self._motion.tare()
            case Rest():
                await self._control.wait(step.seconds)
            case Turn():
                await self._turn(step)
            case Baseline():
                self._publish("baseline", f"{step.seconds:g} s without contact begin")
                await self._control.wait(step.seconds)
                self._publish("baseline", "the time without contact ends")
            case ApproachOnly():
                await self._press(step)

    async def _change_plate(self, step: ChangePlate) -> None:
        if not self._unattended:
            await self._ask(step.prompt, step.texture)
        self._set_plate(step.texture)
        self._texture = step.texture
        self._tared = False
        self._pipeline.set_recorder(None)
        self._part_reason = self._part_reason or "plate"

    async def _run_trial(self, trial: PlannedTrial) -> None:
        if self.committed_attempt(trial.trial_id):
            return  # only the lift behind it failed: the drum is back, and the trial counts
        for _ in range(self._quality.attempts):
            self.current = trial
            if self._pressed is None:
                await self._prepare()
            if await self._attempt(trial):
                return
            self._progress.rejected += 1
        self._control.check()  # a pause for failures in a row: the trial begins again after it
        self._progress.finish(trial)
        text = f"trial {trial.trial_id} is given up after {self._quality.attempts} attempts"
        self._publish("trial", text, trial_id=trial.trial_id)

    async def _turn(self, step: Turn) -> None:
        data = {"speed_mm_s": step.speed_mm_s, "turns": step.turns}
        await self._motion.move_to_quarter()
        what = f"{step.turns} turns at {step.speed_mm_s:g} mm/s, lifted,"
        self._publish("turn", f"{what} begin", **data, begins=True)
        await self._motion.turn(step.speed_mm_s, step.turns + 1)
        error_steps = await self._motion.index_error_steps()
        self._publish("turn", f"{what} end", **data, begins=False, index_error_steps=error_steps)

    async def _press(self, step: ApproachOnly) -> None:
        await self._motion.write_settings(**press_settings(step.force_g))
        await self._motion.approach()
        self._publish("approach", f"{step.force_g:g} g without travel begin")
        await self._control.wait(step.seconds)
        self._publish("approach", "the press ends")
        await self._without_pauses(self._motion.lift)

    async def _show_message(self, step: Message) -> None:
        self._publish("message", step.text)
        if step.wait and not self._unattended:
            await self._ask(step.text, None)

    async def _ask(self, text: str, texture: str | None) -> None:
        """Make the rig safe, ask the operator and wait for the answer."""
        with self._progress.idle():
            await self.make_safe()
            await self._control.ask(text, texture)

    async def _prepare(self) -> None:
        """Record, arm, home and tare, as far as necessary."""
        if not self._pipeline.is_recording:
            self._recorder.begin_part(self._part_reason or "continued", self._texture)
            self._pipeline.set_recorder(self._recorder)
            self._part_reason = ""
            if self._start_counters is None:
                self.record_health(START)
        await self._motion.arm()
        if not self._motion.homed:
            await self._motion.home()
        state = self._motion.poller.healthy_state()
        if not (self._tared and has_status(state, Status.TARED)):  # a reset forgets the zero
            await self._motion.tare()
            self._tared = True

    async def _attempt(self, trial: PlannedTrial) -> bool:
        """Run the trial once, store its row in any case, and return whether it is committed."""
        self._attempts[trial.trial_id] += 1
        number = self._attempts[trial.trial_id]
        attempt = TrialAttempt(self._motion, self._pipeline, trial, number, self._protocol)
        in_contact, self._pressed = self._pressed is not None, RunTrial(trial)
        try:
            reasons = await attempt.run(in_contact=in_contact)
        except (RunPaused, RunStopped, TrialSkipped, RigFault) as interruption:
            self._store(attempt, Verdict.ABORTED, (str(interruption),))
            raise
        if attempt.drift_g:
            text = f"the lifted load cell read {attempt.drift_g:+.1f} g: tared"
            self._publish("tare", text, trial_id=trial.trial_id, force_g=round(attempt.drift_g, 2))
        found = DataVerdict() if reasons else attempt.judged_by(self._history)
        reasons = reasons or found.repeat
        data: dict[str, Any] = {"index_error_steps": await self._motion.index_error_steps()}
        if attempt.start_by_clock is not None:
            uncertainty_ms = attempt.start_by_clock.uncertainty_ms
            data |= {"cut_by": CUT_BY_CLOCK, "cut_uncertainty_ms": uncertainty_ms}
        self._store(attempt, Verdict.REJECTED if reasons else Verdict.COMMITTED, reasons, **data)
        try:
            await self._after_attempt(trial, reasons, found)
        finally:
            if not reasons:
                self._progress.commit(trial)  # also where the lift behind it fails
        return not reasons

    async def _after_attempt(
        self, trial: PlannedTrial, reasons: tuple[str, ...], found: DataVerdict
    ) -> None:
        """Tell of a quarantine, count failures in a row, and lift where the protocol does."""
        if found.quarantine:
            text = f"trial {trial.trial_id} is in quarantine: {'; '.join(found.quarantine)}"
            attempt = self._attempts[trial.trial_id]
            self._publish(QUARANTINE_KIND, text, trial_id=trial.trial_id, attempt=attempt)
        self._count_failure(trial, reasons or found.quarantine, found.broken)
        if self._protocol.lift == EACH_TRIAL or reasons or found.quarantine:
            # A pause must not interrupt this lift: the stored trial would run again.
            await self._without_pauses(self._leave_contact)

    async def _leave_contact(self) -> None:
        if self._pressed is not None:
            self._pressed = None
            await self._motion.lift()
            await self._motion.write_settings(**self._run_in)

    def _count_failure(
        self, trial: PlannedTrial, reasons: tuple[str, ...], broken: tuple[int, ...]
    ) -> None:
        """Pause after several attempts in a row that were not good, with a diagnosis."""
        if not reasons:
            self._failures.clear()
            return
        self._failures.append(FailedAttempt(trial.trial_id, reasons, broken))
        if len(self._failures) == self._quality.pause_after_failures:
            self._control.pause_for(diagnose(self._failures, self._motion.config.taxels))
            self._failures.clear()
            # What a person has put right need not read as before.
            self._history = TrialHistory(self._quality)

    async def _without_pauses(self, move: Callable[[], Any]) -> None:
        """Complete one move, regardless of reasons to pause or stop."""
        check, self._motion.check = self._motion.check, self._control.check_in
        try:
            await move()
        finally:
            self._motion.check = check

    def _store(
        self, attempt: TrialAttempt, verdict: Verdict, reasons: tuple[str, ...], **data: Any
    ) -> None:
        row = attempt.row(verdict, reasons)
        self._recorder.commit_trial(row)
        if verdict is Verdict.COMMITTED:
            self._committed[row.trial.trial_id] = row.attempt
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._publish(
            "trial",
            f"trial {row.trial.trial_id} {verdict}{why}",
            trial_id=row.trial.trial_id,
            attempt=row.attempt,
            verdict=str(verdict),
            reasons=list(reasons),
            **data,
        )
        self._publish_clocks()

    def _publish_clocks(self) -> None:
        """Publish both boards' clock errors with the first trial and when they change."""
        fits = (self._motion.poller.clock_fit, self._pipeline.clock_fit)
        ppm = [fit.ppm or 0.0 for fit in fits]
        changes = [abs(new - old) for new, old in zip(ppm, self._clocks_ppm, strict=True)]
        if max(changes) < CLOCK_EVENT_PPM:
            return
        self._clocks_ppm = ppm
        self._publish(
            "clock",
            f"clocks against the computer's: drum {ppm[0]:+.0f} ppm, taxels {ppm[1]:+.0f} ppm",
            drum_ppm=round(ppm[0], 1),
            taxels_ppm=round(ppm[1], 1),
        )


def remaining_steps(steps: Iterable[Step], done: frozenset[int]) -> Iterator[Step]:
    """Yield the steps to run when some trials are committed already.

    A plate is mounted only if a step on it remains. Free steps before the first remaining
    trial were run in an earlier sitting, unless no trial is committed.
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


def mountings_before(steps: Sequence[Step], done: frozenset[int]) -> int:
    """Return how many plates earlier sittings mounted before the one that a run begins with."""
    remaining = remaining_steps(steps, done)
    first = next((step for step in remaining if isinstance(step, ChangePlate)), None)
    before = takewhile(lambda step: step is not first, steps if first is not None else ())
    return sum(isinstance(step, ChangePlate) for step in before)
