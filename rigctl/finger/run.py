"""A run of the finger's protocol: its scans in order, with pauses, questions and repeats.

::

    running ─► done            every scan made, the session closed
     │   ▲
     ▼   │ last reason gone    the interrupted scan repeats
    paused, prompt
     │
     ├─► aborted               stopped by a person or a client
     └─► failed                board or tracker failed, or the disk for good

However a run ends, the session is complete.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from rigctl.encoder.normalisation import Normalisation
from rigctl.engine.event_bus import EventBus
from rigctl.engine.rpc.messages import LINK
from rigctl.engine.run_reasons import RunPaused, RunStopped
from rigctl.engine.served_run import ServedRun
from rigctl.errors import DiskFault, LinkLost, RigctlError, RigFault
from rigctl.finger.board_messages import N_TAXELS, NO_GAIN, Message
from rigctl.finger.control import CHECK_PERIOD_S, FingerControl
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.devices import FingerDevices
from rigctl.finger.latency import LatencyLog
from rigctl.finger.live_answers import LiveAnswers
from rigctl.finger.progress import FingerProgress
from rigctl.finger.recorder import FingerRecorder
from rigctl.finger.rig import FingerRig
from rigctl.finger.run_request import OpenedFingerRun
from rigctl.finger.scan_attempt import ScanAttempt
from rigctl.finger.scan_recording import ScanOutput, track_row, trial_row
from rigctl.finger.session import FingerSession
from rigctl.finger.status import CurrentScan, FingerRunStatus
from rigctl.finger.trackers.plate_frame import PlatePosition
from rigctl.finger.values import MODEL_KIND, FingerTrial, PredictionRow, Stage
from rigctl.session.sensor_passport import sensor_difference
from rigctl.values import Event, Position, Verdict

REFUSALS = 3
"""Of a disk that takes no scan between them; then the run fails."""
TRY_DISK_EVERY_S = 5.0


class FingerRun(ServedRun[FingerControl, FingerRecorder]):
    """One sitting of one plan of the moving finger."""

    def __init__(
        self,
        rig: FingerRig,
        devices: FingerDevices,
        event_bus: EventBus,
        opened: OpenedFingerRun,
        latencies: LatencyLog,
    ) -> None:
        now_s = rig.loop.time
        control = FingerControl(now_s, event_bus, lambda: opened.recorder.failure)
        super().__init__(control, opened.recorder, event_bus, opened.missing)
        self.output = ScanOutput(opened.recorder, event_bus, latencies, now_s)
        self._rig = rig
        self._devices = devices
        self._opened = opened
        self._now_s = now_s
        self._attempts: Counter[int] = Counter(opened.attempts)
        self._scans = opened.scans
        self._progress = FingerProgress(opened.plan, opened.done, now_s, opened.rejected)
        for true, answer in opened.named:
            self._progress.classify(true, answer)
        self._attempt: ScanAttempt | None = None
        self._texture: str | None = None
        self._stage: Stage | None = None
        self._given_up: set[int] = set()
        self.is_recording = False

    def has_scanned(self, scan: int) -> bool:
        """Return whether a scan of this number is or was under way in this sitting."""
        return self.is_recording and self._opened.scans < scan <= self._scans

    @contextmanager
    def _recording(self) -> Iterator[None]:
        unsubscribe = (
            self._event_bus.subscribe(self._record_event),
            self._devices.subscribe(self._record_block, self._pass, self._record_position),
        )
        try:
            yield
        finally:
            for end in unsubscribe:
                end()
            self.is_recording = False

    def status(self) -> FingerRunStatus:
        """Return the run's part of the status message."""
        progress, control = self._progress, None if self.ended else self.control
        return FingerRunStatus(
            state=self.state,
            text=self.text,
            reasons=control.reasons if control else (),
            trials_planned=progress.planned,
            trials_committed=progress.committed,
            trials_rejected=progress.rejected,
            eta_s=progress.eta_s() if control else None,
            elapsed_s=progress.clock.elapsed_s,
            scan=self._current_scan(),
            prompt=control.prompt if control else None,
            session=str(self.folder),
            textures=progress.textures,
            classified=progress.classified,
            correct=progress.correct,
            confusion=progress.confusion,
            coverage=self._opened.coverage,
            quality=progress.quality,
        )

    def _current_scan(self) -> CurrentScan | None:
        if self._attempt is None or self.ended:
            return None
        trial = self._attempt.trial
        return CurrentScan(
            trial.stage.value,
            trial.texture,
            trial.profile.value,
            trial.repeat,
            self._attempts[trial.trial_id],
            self._attempt.scanning,
            trial.trial_id,
        )

    async def _run_plan(self) -> tuple[str, str]:
        try:
            await self._run_trials()
        except RunStopped as stop:
            return "aborted", str(stop)
        except RigctlError as error:
            self._event_bus.publish("fault", str(error))
            return "failed", str(error)
        missing = self._progress.planned - self._progress.committed
        if missing:
            return "done", f"scans that could not be committed: {missing}; see their reasons"
        return "done", "every scan is committed"

    async def _run_trials(self) -> None:
        """Make the scans until each that is committed is on the disk, or given up.

        Raises DiskFault where the disk refuses again and again, or for good.
        """
        done, refusals = self._opened.done, 0
        while True:
            try:
                for trial in self._opened.plan.trials:
                    if trial.trial_id not in done | self._given_up:
                        await self._run_trial(trial)
                return self._recorder.wait_written()
            except DiskFault:
                if not self._recorder.may_try_again or refusals == REFUSALS:
                    raise
            before, done = done, await self._wait_for_disk()
            refusals = refusals + 1 if done == before else 0

    async def _wait_for_disk(self) -> frozenset[int]:
        """Pause until the disk takes files again; return the scans that are committed on it.

        Raises RunStopped.
        """
        with self._progress.clock.idle():
            on_disk = await self._until_disk_works(self._wait_to_try_again)
        self._progress.reopen(on_disk, self._given_up)
        return on_disk

    async def _wait_to_try_again(self) -> None:
        end_s = self._now_s() + TRY_DISK_EVERY_S
        while self._now_s() < end_s:
            await asyncio.sleep(CHECK_PERIOD_S)
            self.control.check_stop()

    async def _begin_stage(self, stage: Stage) -> None:
        """Set the ranges that the stage uses, and begin the part that holds them."""
        ranges = self._ranges(stage)
        await self._configure(ranges)
        header = replace(
            self._opened.header,
            taxel_low=tuple(ranges.low.tolist()),
            taxel_high=tuple(ranges.high.tolist()),
        )
        reason = f"stage {stage.value}" + (", continued" if self._opened.resumed else "")
        self._recorder.begin_part(reason, header=header)
        self.is_recording, self._stage = True, stage
        self._event_bus.publish("stage", f"stage {stage.value} begins", stage=stage.value)
        self.output.answers = self._answers() if stage is Stage.RUN else None

    def _answers(self) -> LiveAnswers | None:
        """Return what names the scans; the session says which model it is."""
        classifier = self._opened.classifier
        if classifier is None:
            return None
        name, digest = classifier.model.representation, self._opened.model_digest
        text = f"a model of {name} names the scans, SHA-256 {digest[:16]}…"
        self._event_bus.publish(MODEL_KIND, text, representation=name, digest=digest)
        header, trained = self._opened.header, classifier.model.training.inputs
        now = {"sensor": header.sensor, "passport": header.passport}
        if trained and (change := sensor_difference(trained[-1], now)):
            self._event_bus.publish("check", f"WARNING: the model was trained on {change}")
        return LiveAnswers(classifier)

    async def _configure(self, ranges: Normalisation) -> None:
        """Set the board's ranges and gain; a board that is lost meanwhile is waited for."""
        gain = self._opened.header.gain(ranges) or NO_GAIN
        while True:
            try:
                self.control.check()
                await self._devices.configure(ranges, self._opened.reference_um_per_s, gain)
                return
            except RunPaused:
                await self._wait_resumed()
            except LinkLost:
                if LINK not in self.control.reasons:
                    raise

    def _ranges(self, stage: Stage) -> Normalisation:
        """Return the range of each taxel: all before normalisation, its own or the model's after.

        Raises RigFault where the normalisation scans leave a taxel without a range.
        """
        if stage is Stage.NORMALISE:
            return Normalisation.full_scale(N_TAXELS)
        if self._opened.classifier is not None:
            return self._opened.classifier.model.normalisation
        return self._opened.ranges or self._recorded_ranges()

    def _recorded_ranges(self) -> Normalisation:
        """Return the lowest and highest reading of each taxel in the normalisation scans."""
        self._recorder.wait_written()
        with FingerSession.open(self._recorder.folder) as session:
            rows = [i for i in session.committed() if session.trials["stage"][i] == "normalise"]
            if not rows:
                raise RigFault(
                    "no normalisation scan is committed, so the taxels have no ranges: plan the "
                    "stage normalise before train"
                )
            ranges = Normalisation.from_samples(map(session.samples, rows), "normalisation scans")
        flat = np.flatnonzero(ranges.low >= ranges.high)
        if len(flat):
            raise RigFault(
                f"taxel {flat[0] + 1} did not change in the normalisation scans: check its wires"
            )
        return ranges

    async def _run_trial(self, trial: FingerTrial) -> None:
        """Make one scan; repeat it after a pause, and while its data are not good."""
        if trial.stage is not self._stage:
            await self._begin_stage(trial.stage)
        quality = self._opened.plan.protocol.quality
        tries = 0
        while tries < quality.attempts:
            try:
                await self._ask_for_plate(trial)
                self.control.check()
                if await self._attempt_scan(trial):
                    self._progress.commit()
                    return
                tries += 1
                self._progress.rejected += 1
            except RunPaused:
                await self._wait_resumed()
        self._event_bus.publish("log", f"scan {trial.trial_id} is given up, attempts: {tries}")
        self._given_up.add(trial.trial_id)
        self._progress.finish()

    async def _wait_resumed(self) -> None:
        with self._progress.clock.idle():
            await self.control.wait_resumed()

    async def _ask_for_plate(self, trial: FingerTrial) -> None:
        if trial.texture == self._texture:
            return
        if not self._opened.unattended:
            text = f"Lay plate {trial.texture} under the finger, then confirm."
            with self._progress.clock.idle():
                await self.control.ask(text, trial.texture)
        self._texture = trial.texture

    async def _attempt_scan(self, trial: FingerTrial) -> bool:
        """Make one attempt, store it, and return whether it is committed."""
        self._attempts[trial.trial_id] += 1
        self._scans += 1
        attempt = ScanAttempt(trial, self._scans, self._rig, self._devices, self.output)
        self._attempt = attempt
        self.output.begin_scan()
        text = f"plate {trial.texture}, {trial.profile.value}: slide over the plate"
        about = {"trial_id": trial.trial_id, "attempt": self._attempts[trial.trial_id]}
        plate = {"texture": trial.texture, "profile": trial.profile}
        self._event_bus.publish("instruction", text, **about, **plate)
        try:
            reasons = await attempt.run(self.control, self._opened.plan.protocol.quality)
        except (RunPaused, RunStopped, RigFault) as interruption:
            self._store(attempt, Verdict.ABORTED, (str(interruption),))
            raise
        self._store(attempt, Verdict.REJECTED if reasons else Verdict.COMMITTED, reasons)
        return not reasons

    def _store(self, attempt: ScanAttempt, verdict: Verdict, reasons: tuple[str, ...]) -> None:
        trial, answer = attempt.trial, self.output.prediction
        predicted = answer.texture if answer is not None and answer.is_final else ""
        number = self._attempts[trial.trial_id]
        times_s = attempt.started_s, self._now_s()
        row = trial_row(
            trial, number, attempt.scan, attempt.measures, verdict, reasons, times_s, predicted
        )
        self._recorder.commit_trial(row)
        if predicted and verdict is Verdict.COMMITTED:
            self._progress.classify(trial.texture, predicted)
        why = f": {'; '.join(reasons)}" if reasons else ""
        named = _named(answer) if predicted and answer is not None else ""
        self._event_bus.publish(
            "trial",
            f"scan {trial.trial_id} ({trial.texture}, {trial.profile.value}) {verdict}{named}{why}",
            trial_id=trial.trial_id,
            attempt=number,
            texture=trial.texture,
            predicted=predicted,
            verdict=str(verdict),
            reasons=list(reasons),
        )

    def _record_event(self, event: Event) -> None:
        if self.is_recording and event.kind not in ("batch", "prediction"):
            self._recorder.add_event(event)

    def _record_block(self, block: FingerBlock, arrived_s: float) -> None:
        if self.is_recording:
            self._recorder.add_samples(block, arrived_s)

    def _record_position(self, position: Position, plate: PlatePosition) -> None:
        if self.is_recording:
            self._recorder.add_row(track_row(position, plate))

    def _pass(self, message: Message, arrived_s: float) -> None:
        """Take no message: the attempt records what belongs to a scan."""


def _named(answer: PredictionRow) -> str:
    """Return what the classifier said of a scan."""
    unknown = "" if answer.known else ", though it is unlike every trained plate"
    return f", named {answer.texture}{unknown}"
