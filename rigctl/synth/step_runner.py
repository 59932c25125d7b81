"""Run a plan's steps on the direct rig; record, cut and check each trial like a real run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from rigctl.bench.direct_rig import POLL_MS, DirectRig
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command, CommandResult, Status
from rigctl.boards.drum_states import Fault, State
from rigctl.config.rig_config import RigConfig
from rigctl.engine.settings import (
    MAX_TARGET_STEPS,
    nearest_steps,
    press_settings,
    rig_settings,
    settle_settings,
    trial_settings,
    trial_start_steps,
    way_to_window_mm,
)
from rigctl.engine.trial_cutter import TrialCutter
from rigctl.engine.trial_quality import MeasuredTrial, judge, measure, trial_row
from rigctl.errors import BoardFault, DiskFault
from rigctl.protocol.plan import EACH_TRIAL, Protocol, Settle
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
from rigctl.session.ground_truth import TruthLog, TruthRows
from rigctl.synth.resume import ResumedRecorder
from rigctl.values import Block, DrumState, Event, LoadcellSample, PlannedTrial, Verdict

LEAD_US = 110_000
"""Recorded before the rise of sync; longer than the polling period, so that it contains a poll."""

SEAM_US = 2_000
"""Polls this soon after the start of a stretch are left out: they could precede earlier ones."""

POLLS_KEPT = 3


class TrialRecording:
    """Records one stretch at a time and passes it to ``on_block`` and ``on_drum``."""

    def __init__(
        self,
        rig: DirectRig,
        on_block: Callable[[Block], None],
        on_drum: Callable[[DrumState], None],
    ) -> None:
        self._rig = rig
        self._taxels = rig.taxels
        self._on_block = on_block
        self._on_drum = on_drum
        self._clock_rate = 1.0 + rig.parameters.drum_clock_ppm * 1e-6
        self._next_frame = 0
        self._skipped_frames = 0
        self._recent_polls: list[DrumState] = []
        self._conversions = 0
        self._edges_us = [0, 0]
        self._start_us = 0.0
        self._truth_rows = 0

    @property
    def now_s(self) -> float:
        """Session time of the end of the samples."""
        return self._session_s(self._taxels.start_us(self._next_frame))

    def buffer_poll(self, poll: DrumState) -> None:
        """Keep a poll outside of a stretch; the next stretch may begin before it."""
        self._recent_polls = [*self._recent_polls[1 - POLLS_KEPT :], poll]

    def begin(self, at_us: float) -> None:
        """Begin a stretch ``LEAD_US`` before this simulated time, which is less than 2 s ago."""
        first = max(self._next_frame, self._taxels.first_frame_from(at_us - LEAD_US))
        self._skipped_frames += first - self._next_frame
        self._next_frame = first
        self._start_us = self._taxels.start_us(first)
        polls, self._recent_polls = self._recent_polls, []
        self._record_polls(polls)

    def record(self, polls: Sequence[DrumState]) -> None:
        """Record these polls, and the samples up to the last of them."""
        end = self._taxels.ended_frames(polls[-1].at_s * 1e6)
        samples, flags, edges = self._taxels.read_frames(self._next_frame, end)
        numbers = np.arange(self._next_frame, end, dtype=np.int64) - self._skipped_frames
        self._next_frame = end
        at_s = self._session_s(polls[-1].at_s * 1e6)
        self._on_block(Block(numbers, samples, flags, edges, (), at_s))
        self._record_polls(polls)

    def end(self) -> TruthRows:
        """End the stretch at the last :meth:`record`; return its ground truth."""
        log = self._rig.truth.take()
        shift_ms = round(self._skipped_us / 1000)
        first, end = self._truth_rows, int(self.now_s * 1000)
        self._truth_rows = end
        rows = slice(first + shift_ms - log.first_ms, end + shift_ms - log.first_ms)
        return first, log.speed_mm_s[rows], log.force_g[rows], log.sync[rows]

    @property
    def _skipped_us(self) -> float:
        return self._skipped_frames * self._taxels.frame_us

    def _session_s(self, simulated_us: float) -> float:
        return (simulated_us - self._skipped_us) * 1e-6

    def _session_board_us(self, board_us: int) -> int:
        return math.floor(board_us - self._skipped_us * self._clock_rate)

    def _record_polls(self, polls: Sequence[DrumState]) -> None:
        """Record the polls that belong to this stretch."""
        for poll in polls:
            if poll.at_s * 1e6 >= self._start_us + SEAM_US:
                self._on_drum(self._in_session_time(poll))

    def _in_session_time(self, poll: DrumState) -> DrumState:
        rise_us, fall_us = self._edges(poll)
        return replace(
            poll,
            at_s=self._session_s(poll.at_s * 1e6),
            board_time_us=self._session_board_us(poll.board_time_us),
            sync_rise_us=rise_us,
            sync_fall_us=fall_us,
            loadcell=self._loadcell_samples(poll.loadcell),
            loadcell_lost=0,
            values={},
        )

    def _edges(self, poll: DrumState) -> list[int]:
        """Return session times of the last edges; edges before this stretch keep theirs."""
        for index, at_us in enumerate((poll.sync_rise_us, poll.sync_fall_us)):
            if at_us >= self._start_us * self._clock_rate:
                self._edges_us[index] = self._session_board_us(at_us)
        return self._edges_us

    def _loadcell_samples(self, samples: Sequence[LoadcellSample]) -> tuple[LoadcellSample, ...]:
        """Return the samples of this stretch, with the session's numbers and times."""
        first_us = (self._start_us + SEAM_US) * self._clock_rate
        skipped_us = self._skipped_us * self._clock_rate
        taken = [sample for sample in samples if sample.board_time_us >= first_us]
        first, self._conversions = self._conversions + 1, self._conversions + len(taken)
        return tuple(
            LoadcellSample(number, math.floor(at_us - skipped_us), counts, force_g)
            for number, (_, at_us, counts, force_g) in enumerate(taken, first)
        )


MAX_STEP_US = 700_000
"""Longest time between two reads of the polls; the board's ring of conversions holds 0.8 s."""

LIFTED_S = 0.5

UNPOLLED_STEP_US = 10_000_000
"""Longest simulated step without polling."""

TIMEOUT_US = 300_000_000
OnPolls = Callable[[list[DrumState]], None]


class DrumOperator:
    """Drives one drum. Every method returns when its move has ended. Raises BoardFault."""

    def __init__(self, rig: DirectRig, config: RigConfig, settle: Settle) -> None:
        self.rig = rig
        self._config = config
        self._homed = False
        self._wait_until(lambda: rig.state is State.IDLE, "booting")
        rig.write_settings(
            **rig_settings(config),
            **settle_settings(settle),
            clock_trim_ppm=round(rig.parameters.drum_clock_ppm),
        )
        self._send(Command.COMMISSION)
        self._wait_until(lambda: rig.result is not CommandResult.RUNNING, "keeping the settings")
        self._run_command(Command.ARM, State.ARMED)

    def wait(self, seconds: float, on_polls: OnPolls = lambda polls: None) -> None:
        """Let time pass; ``on_polls`` as in :meth:`run_window`."""
        end_us = self.rig.time_us + round(seconds * 1e6)
        self.rig.start_polling()
        while self.rig.time_us < end_us:
            self._advance(min(end_us, self.rig.time_us + MAX_STEP_US))
            on_polls(self.rig.take_polls())
        self.rig.stop_polling()

    def tare(self) -> None:
        """Tare the load cell, lifted and at rest."""
        self._send(Command.TARE)
        self._wait_until(lambda: self.rig.result is not CommandResult.RUNNING, "the tare")

    def prepare(self, trial: PlannedTrial) -> None:
        """Write a trial's set-points and move, lifted, to the start of its run-in."""
        self.rig.write_settings(**trial_settings(trial, self._config.drum))
        steps, target = self._start(trial)
        if not self._homed or abs(target) > MAX_TARGET_STEPS:
            self._run_command(Command.HOME, State.ARMED)
            self._homed = True
            steps, target = self._start(trial)
        self.rig.write_settings(move_target=target)
        if target != steps:
            self._run_command(Command.MOVE, State.ARMED)

    def prepare_in_contact(self, trial: PlannedTrial) -> None:
        """Write a trial's set-points; its run-in begins where the drum holds."""
        drum, steps = self._config.drum, int(self.rig.read("steps"))
        way_mm = way_to_window_mm(trial, steps, drum, self.rig.parameters.mm_per_step)
        self.rig.write_settings(**trial_settings(trial, drum), run_in_set=way_mm)

    def lifted_force_g(self) -> float:
        """Return the mean reading of the lifted load cell over half a second."""
        polls: list[DrumState] = []
        self.wait(LIFTED_S, polls.extend)
        return float(np.mean([sample.force_g for poll in polls for sample in poll.loadcell]))

    def approach(self) -> None:
        """Press until the force has settled."""
        self.rig.write_settings(run_in_set=self._config.drum.run_in_mm)
        self._run_command(Command.APPROACH, State.HOLD)

    def press(self, force_g: float) -> None:
        """Approach with this force instead of a trial's."""
        self.rig.write_settings(**press_settings(force_g))
        self.approach()

    def run_window(self, on_polls: OnPolls) -> None:
        """Run in, pass the window and ramp down; ``on_polls`` gets the polls at intervals."""
        self._send(Command.RUN)
        # The run-in takes at least its length over the speed; until then nothing needs polling.
        run_in_us = self.rig.read("run_in_set") / self.rig.read("speed_set") * 1e6
        self._advance(self.rig.time_us + round(run_in_us) - MAX_STEP_US, stop_on_change=False)
        self.rig.start_polling()
        self._wait_until(
            self._has_ended(State.HOLD), "the travel", lambda: on_polls(self.rig.take_polls())
        )
        # The last poll shows the closed window, however short the ramp down was.
        self._advance(self.rig.time_us + 1000 * POLL_MS)
        on_polls(self.rig.take_polls())
        self.rig.stop_polling()

    def lift(self) -> None:
        """Lift off."""
        self._run_command(Command.RETRACT, State.ARMED)

    def _start(self, trial: PlannedTrial) -> tuple[int, int]:
        """Return the drum's present position and the start of the run-in, steps."""
        p, steps_now = self.rig.parameters, int(self.rig.read("steps"))
        within_turn = trial_start_steps(trial, self._config.drum, p.mm_per_step)
        return steps_now, nearest_steps(within_turn, steps_now, round(p.steps_per_turn))

    def _send(self, command: Command) -> None:
        if not self.rig.command(command):
            raise BoardFault(f"the simulated drum refused {command.name} in {self.rig.state.name}")

    def _run_command(self, command: Command, end: State) -> None:
        self._send(command)
        self._wait_until(self._has_ended(end), command.name)

    def _has_ended(self, end: State) -> Callable[[], bool]:
        return lambda: self.rig.state is end and self.rig.result is not CommandResult.RUNNING

    def _wait_until(
        self, ended: Callable[[], bool], what: str, on_step: Callable[[], None] | None = None
    ) -> None:
        deadline_us = self.rig.time_us + TIMEOUT_US
        while not ended():
            if self.rig.time_us > deadline_us:
                raise BoardFault(f"the simulated drum did not end {what}")
            self._advance(self.rig.time_us + (MAX_STEP_US if on_step else UNPOLLED_STEP_US))
            if on_step is not None:
                on_step()

    def _advance(self, until_us: int, stop_on_change: bool = True) -> None:
        """Advance to a time, or until a move ends. Raises BoardFault on a fault."""
        self.rig.advance(until_us, stop_on_change)
        if self.rig.fault is not Fault.NONE:
            raise BoardFault(f"the simulated drum stopped with {self.rig.fault.name}")


QUEUE_SAMPLES = 100_000
"""The simulation waits for the disk when more samples are queued."""

TRUTH_ROWS = 60_000
"""Milliseconds of ground truth that are written at once: a killed run loses no more."""


class DatasetStepRunner:
    """Runs the steps of a plan and records the session.

    With several ``workers`` a thread computes noise in advance; the samples are the same.
    """

    def __init__(
        self,
        protocol: Protocol,
        parameters: WorldParameters,
        seed: int,
        truth_log: TruthLog,
        recorder: ResumedRecorder,
        workers: int,
    ) -> None:
        self._recorder = recorder
        self._executor = ThreadPoolExecutor(1, "noise") if workers > 1 else None
        self._rig = DirectRig(parameters, seed, self._executor, protocol.config.taxels)
        self._operator = DrumOperator(self._rig, protocol.config, protocol.settle)
        self._recording = TrialRecording(self._rig, self._add_block, self._add_drum)
        self._quality = protocol.quality
        self._cutter = TrialCutter()
        self._loadcell: list[LoadcellSample] = []
        self._last_poll: DrumState | None = None
        self._set_points = (0.0, 0.0)
        self._texture = ""
        self._reason = "start"
        self._tared = False
        self._protocol = protocol
        self._pressed: RunTrial | None = None
        self._truth_log = truth_log
        self._truth: list[TruthRows] = []
        self._truth_rows = 0
        self.committed = 0

    def close(self) -> None:
        """Write the remaining ground truth and free the rig."""
        if self._reason == "start":  # nothing was recorded
            self._recorder.begin_part(self._reason, self._texture)
        self._write_truth()
        self._truth_log.close()
        self._rig.close()
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)

    def run(self, step: Step) -> None:
        """Run one step of the plan. Raises BoardFault and DiskFault."""
        if self._protocol.way_between_mm(self._pressed, step) is None:
            self._lift()
        if isinstance(step, ChangePlate):
            self._change_plate(step.texture)
            return
        self._begin()
        match step:
            case RunTrial():
                self._run_trial(step.trial)
            case Tare():
                self._operator.tare()
            case Rest():
                self._operator.wait(step.seconds)
            case Baseline():
                self._record_still(step.seconds, "without contact")
            case Turn():
                self._event("turn", f"{step.turns} turns at {step.speed_mm_s:g} mm/s left out")
            case ApproachOnly():
                self._operator.press(step.force_g)
                self._record_still(step.seconds, f"pressed with {step.force_g:g} g, no travel")
                self._operator.lift()
            case Message():
                self._event("message", step.text)

    def _lift(self) -> None:
        if self._pressed is not None:
            self._operator.lift()
        self._pressed = None

    def _change_plate(self, texture: str) -> None:
        self._rig.set_plate(texture)
        self._texture = texture
        self._tared = False
        self._reason = self._reason or "plate"

    def _begin(self) -> None:
        """Begin a part and tare, as far as necessary."""
        if self._reason:
            self._recorder.begin_part(self._reason, self._texture)
            self._event("synth", "A virtual data set: session time stops between trials.")
            self._reason = ""
        if not self._tared:
            self._operator.tare()
            self._tared = True

    def _run_trial(self, trial: PlannedTrial) -> None:
        try:
            self.committed += any(
                self._attempt(trial, number) for number in range(1, self._quality.attempts + 1)
            )
        except BoardFault as error:
            raise BoardFault(
                f"trial {trial.trial_id}, plate {trial.texture} at {trial.speed_mm_s:g} mm/s: "
                f"{error}: change the protocol or the world"
            ) from error

    def _attempt(self, trial: PlannedTrial, number: int) -> bool:
        if self._pressed is not None:
            self._operator.prepare_in_contact(trial)
        else:
            self._operator.prepare(trial)
            self._tare_drift()
            self._operator.approach()
        self._pressed = RunTrial(trial)
        self._cutter.expect(trial.n_samples)
        self._loadcell.clear()
        started_s = self._record_window()
        if self._protocol.lift == EACH_TRIAL:
            self._lift()
        cut, measured = self._cutter.trial, self._measure(trial)
        reasons = judge(trial, cut, measured, self._quality)
        verdict = Verdict.REJECTED if reasons else Verdict.COMMITTED
        times_s = started_s, self._now_s()
        row = trial_row(trial, number, verdict, reasons, cut, measured, *times_s)
        self._recorder.add_trial(row)
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._event("trial", f"trial {trial.trial_id} {verdict}{why}", trial_id=trial.trial_id)
        self._throttle()
        if reasons:
            self._lift()
        return not reasons

    def _tare_drift(self) -> None:
        limit_g = self._protocol.drift_limit_g
        if math.isfinite(limit_g) and abs(self._operator.lifted_force_g()) >= limit_g:
            self._operator.tare()

    def _record_window(self) -> float:
        """Run the window; record from before sync rises until after it falls. Return the start."""
        self._read_set_points()
        rises, recording, started_s = self._rig.read("sync_count"), False, self._recording.now_s

        def on_polls(polls: list[DrumState]) -> None:
            nonlocal recording
            inside: list[DrumState] = []
            for poll in polls:
                if poll.sync_count % 65536 == rises:
                    self._recording.buffer_poll(poll)
                    continue
                if not recording and not inside and _is_open(poll):
                    self._recording.begin(self._rig.to_simulated_us(poll.sync_rise_us))
                    recording = True
                if recording:
                    inside.append(poll)
                    recording = _is_open(poll)
            if inside:
                self._recording.record(inside)

        self._operator.run_window(on_polls)
        self._add_truth(self._recording.end())
        return started_s

    def _read_set_points(self) -> None:
        self._set_points = self._rig.read("force_set"), self._rig.read("speed_set")

    def _record_still(self, seconds: float, what: str) -> None:
        self._read_set_points()
        self._recording.begin(self._rig.time_us)
        self._event("still", f"{seconds:g} s {what} begin")
        self._operator.wait(seconds, self._recording.record)
        self._add_truth(self._recording.end())
        self._event("still", f"{seconds:g} s {what} end")
        self._throttle()

    def _measure(self, trial: PlannedTrial) -> MeasuredTrial:
        if self._last_poll is None:
            return MeasuredTrial()
        travel_mm = self._rig.read("travel_set")
        ppm = self._rig.parameters.drum_clock_ppm
        return measure(trial, self._last_poll, self._loadcell, travel_mm, ppm)

    def _now_s(self) -> float:
        return max(self._recording.now_s, self._last_poll.at_s if self._last_poll else 0.0)

    def _add_block(self, block: Block) -> None:
        self._cutter.add_block(block)
        self._recorder.add_block(block)

    def _add_drum(self, state: DrumState) -> None:
        self._last_poll = state
        self._loadcell.extend(state.loadcell)
        self._recorder.add_drum(state, *self._set_points)

    def _event(self, kind: str, text: str, **data: Any) -> None:
        self._recorder.add_event(Event(self._now_s(), kind, text, data))

    def _throttle(self) -> None:
        """Wait for the disk if necessary; a full queue would lose samples."""
        status = self._recorder.status
        if status.failure is not None:
            raise DiskFault(status.failure)
        if status.queue_samples > QUEUE_SAMPLES:
            self._recorder.wait_written()
        if self._truth_rows > TRUTH_ROWS:
            self._write_truth()

    def _add_truth(self, rows: TruthRows) -> None:
        self._truth.append(rows)
        self._truth_rows += len(rows[3])

    def _write_truth(self) -> None:
        if not self._truth:
            return
        columns = [np.concatenate(column) for column in list(zip(*self._truth, strict=True))[1:]]
        self._truth_log.write((self._truth[0][0], columns[0], columns[1], columns[2]))
        self._truth.clear()
        self._truth_rows = 0


def _is_open(poll: DrumState) -> bool:
    """Return whether the trial window is open."""
    return bool(poll.status_bits >> Status.SYNC_HIGH & 1)
