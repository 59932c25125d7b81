"""Run a plan's steps on the direct rig; record, cut and check each trial like a real run."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from rigctl.acquisition.protocol.trial_quality import MeasuredTrial, judge, measure, trial_row
from rigctl.acquisition.taxels.trial_cutter import TrialCutter
from rigctl.errors import DiskFault
from rigctl.protocol.plan import Protocol
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
from rigctl.simulation.bench.world.parameters import WorldParameters
from rigctl.simulation.direct_rig import DirectRig
from rigctl.synth.operator import DrumOperator
from rigctl.synth.resume import ResumedRecorder
from rigctl.synth.trial_recording import TrialRecording
from rigctl.values import Block, DrumState, Event, LoadcellSample, PlannedTrial, Verdict
from rigctl.wire.drum.codes import Status

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
        self._rig = DirectRig(parameters, seed, self._executor)
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
        for number in range(1, self._quality.attempts + 1):
            if self._attempt(trial, number):
                self.committed += 1
                return

    def _attempt(self, trial: PlannedTrial, number: int) -> bool:
        self._operator.prepare(trial)
        self._operator.approach()
        self._cutter.expect(trial.n_samples)
        self._loadcell.clear()
        started_s = self._record_window()
        self._operator.lift()
        cut, measured = self._cutter.trial, self._measure(trial)
        reasons = judge(trial, cut, measured, self._quality)
        verdict = Verdict.REJECTED if reasons else Verdict.COMMITTED
        times_s = started_s, self._now_s()
        row = trial_row(trial, number, verdict, reasons, cut, measured, *times_s)
        self._recorder.add_trial(row)
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._event("trial", f"trial {trial.trial_id} {verdict}{why}", trial_id=trial.trial_id)
        self._throttle()
        return not reasons

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
