"""The engine: both boards, sample pipeline, recorder and runner in one event loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from rigctl.boards.drum_codes import Status
from rigctl.engine.axis import Axis
from rigctl.engine.calibration import Calibration
from rigctl.engine.contact import has_status
from rigctl.engine.early_end import EarlyEndProcess
from rigctl.engine.health import TAXELS, HeartbeatGate, LineMonitor
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.manual_recorder import ManualRecorder
from rigctl.engine.pipeline import FAST, REAL_TIME
from rigctl.engine.rig import Rig
from rigctl.engine.rig_boards import RigBoards
from rigctl.engine.rpc.messages import (
    LINK,
    NOISE,
    EngineStatus,
    RecordingStatus,
    RunStatus,
)
from rigctl.engine.run_queue import RunQueue
from rigctl.engine.run_request import RunContext, RunRequest, open_run
from rigctl.engine.runner import Run
from rigctl.engine.served_engine import ServedEngine
from rigctl.engine.setup.served_setup import ServedSetup
from rigctl.engine.status import StatusBuilder
from rigctl.engine.step_runner import mountings_before
from rigctl.errors import RigctlError, RigFault, WrongUse
from rigctl.session.ground_truth import TruthRecorder
from rigctl.session.layout import DRUM_TRUTH
from rigctl.session.notes import SessionNote, check_note
from rigctl.session.session import ConditionEnd


class Engine(ServedEngine[Run, RunRequest]):
    """The control program of one drum rig.

    ``real_time``: loop time is as fast as real time, so that people can watch.
    """

    def __init__(
        self, rig: Rig, live_writer: LiveWriter, utc_now: Callable[[], str], real_time: bool = True
    ) -> None:
        truth = TruthRecorder(lambda: rig.truth, DRUM_TRUTH)
        super().__init__(rig.loop, rig.description, truth, rig.config)
        self.rig = rig
        self.heartbeat_gate = HeartbeatGate(rig.loop.time)
        self.boards = RigBoards(
            rig,
            live_writer,
            self.event_bus,
            self.spawn,
            self.heartbeat_gate.is_open,
            self._link_changed,
            self._samples_failed,
            REAL_TIME if real_time else FAST,
        )
        self.manual = ManualRecorder(self.boards, self.event_bus, self._begin_beside)
        self.calibration = Calibration(rig, self.boards, self._today)
        self.setup = ServedSetup(rig, self.boards.motion, self.calibration.measurement, self._today)
        self.queue = RunQueue()
        """Runs that wait: the next one begins where the last one is done."""
        self.early_end: EarlyEndProcess | None = None
        """Judges the conditions of the run, where its protocol lets them end early."""
        self._utc_now = utc_now
        self._texture = rig.plate
        self._line_monitor = LineMonitor()
        self._status_builder = StatusBuilder(rig, self.boards, self.calibration, self.setup)

    def start(self, request: RunRequest) -> Run:
        """Start a run.

        Raises where the request or the disk is at fault, WrongUse while the drum is moved by hand.
        """
        self.calibration.measurement.require_none()
        if self.boards.motion.is_moved_by_hand:
            raise WrongUse(
                "the drum is moved by hand: wait until that has ended, or stop it; then start again"
            )
        if self.manual.is_recording:
            raise WrongUse("a recording by hand goes on: end it first, then start the run")
        first_note = self._note(request.notes) if request.notes.strip() else None
        check_in = partial(self.heartbeat_gate.check_in, "runner")
        opened = open_run(request, self._context(request.about))
        self.rig.skip_mountings(mountings_before(opened.plan.steps, opened.done))
        run = Run(self.boards, self.event_bus, opened, check_in, self.set_plate)
        if first_note is not None:
            run.add_note(first_note)
        rule = opened.plan.protocol.early_end
        if rule is not None:
            self.early_end = EarlyEndProcess(run.folder.absolute(), rule, self.event_bus.publish)
        return self._begin(run)

    def start_queued(self) -> Run:
        """Start the first run of the queue, which then has it no more.

        Raises as :meth:`start`; the queue then says why its first run waits.
        """
        try:
            return self.queue.start_first(self.start, self._utc_now())
        except (RigctlError, OSError) as error:
            self.queue.problem = f"the first one could not start: {error}"
            raise

    @property
    def is_needed(self) -> bool:
        """Whether there is work to do without a client: a run, or runs that wait."""
        return super().is_needed or len(self.queue) > 0

    def add_note(self, text: str) -> None:
        """Write a note on the session of the run. Raises WrongUse without a run."""
        self._active_run().add_note(self._note(text))

    def repeat(self, trial_id: int, text: str) -> None:
        """Run a trial of the run once more; its attempt that counted is marked bad.

        Raises WrongUse without a run, and for a trial that cannot be repeated now.
        """
        self._active_run().repeat(trial_id, self._note(text))

    def skip(self, trial_id: int) -> None:
        """Leave out a trial of the run; 0 is the present one. Raises WrongUse where it cannot."""
        self._active_run().skip(trial_id)

    def end_condition(self, end: ConditionEnd) -> None:
        """End a condition of the run early. Raises WrongUse where that cannot be now."""
        if not self._active_run().end_condition(end):
            raise WrongUse("nothing is recorded now: send it again when the run goes on")

    def record_by_hand(self, folder: Path, note: str) -> Path:
        """Begin to record operation by hand; see :meth:`ManualRecorder.begin`."""
        return self.manual.begin(folder, note, self._context(), self._texture)

    def set_plate(self, texture: str) -> bool:
        """Store which plate is mounted; return whether a simulated rig mounted it."""
        mounted = self.rig.set_plate(texture)
        self._texture = texture
        self.manual.change_plate(texture)
        return mounted

    def status(self) -> EngineStatus:
        """Return the status message."""
        recording, run = RecordingStatus(), RunStatus()
        if self.run is not None:
            recording = self.run.recording_status(self.boards.pipeline.is_recording)
            run = self.run.status()
        recording = self.manual.status() or recording
        queue = self.queue.status(run)
        now_s, lsl = self._now_s(), self.lsl.scope
        return self._status_builder.build(now_s, self._texture, recording, run, queue, lsl)

    async def send_stop(self, text: str) -> None:
        """Stop and lift, ahead of everything else; a run ends."""
        if self.run is not None:
            self.run.control.abort(text)
        self.boards.motion.stop_count += 1
        if self.rig.axis is not None:  # as soon as the drum's stop is on its way
            self.loop.call_soon(self._stop_axis, self.rig.axis)
        await self.rig.drum.stop()
        self.calibration.measurement.cancel()
        self.event_bus.publish("stop", text)

    def _stop_axis(self, axis: Axis) -> None:
        try:
            axis.stop()
        except RigFault as fault:
            self.event_bus.publish("fault", str(fault))

    async def move_axis(self, height_mm: float) -> float:
        """Move the axis and return its height, which is an event of what is recorded.

        Raises WrongUse without an axis, and as :meth:`Axis.move_to`.
        """
        axis = self.rig.axis
        if axis is None:
            raise WrongUse("this rig has no further axis: describe it in [axis] of rig.toml")
        self.event_bus.publish("axis", f"the axis moves to {height_mm:g} mm")
        try:
            return await axis.move_to(height_mm, self.boards.drum_poller)
        finally:
            stands_mm = axis.height_mm
            self.event_bus.publish("axis", f"the axis is at {stands_mm} mm", height_mm=stands_mm)

    def _context(self, about: Mapping[str, Any] | None = None) -> RunContext:
        """Return the rig as it is now, for a session that begins."""
        boards = tuple(self.boards.identities.values())
        drum = self.boards.drum_poller.state
        presses = drum is not None and has_status(drum, Status.COMMISSIONED)
        presses = presses or self.rig.commissions  # a run's first settings commission it again
        return RunContext(self.rig, boards, self._utc_now(), presses, about or {})

    def _active_run(self) -> Run:
        if self.run is None or self.run.ended:
            raise WrongUse("no run is active: start one first")
        return self.run

    def _today(self) -> str:
        """Return the date in UTC."""
        return datetime.fromisoformat(self._utc_now()).astimezone(UTC).strftime("%Y-%m-%d")

    def _note(self, text: str) -> SessionNote:
        made = datetime.fromisoformat(self._utc_now()).astimezone(UTC)
        return check_note(SessionNote(made.strftime("%Y-%m-%dT%H:%M:%SZ"), text.strip()))

    def _describe(self) -> dict[str, Any]:
        rig = {"rig_toml": self.rig.config.to_toml(), "world": self.rig.world}
        return {**super()._describe(), **rig}

    async def _connect(self) -> None:
        await self.boards.connect()
        if self.rig.axis is not None:
            await self.rig.axis.connect()

    async def _execute(self, run: Run) -> None:
        self.heartbeat_gate.check_in("runner")
        try:
            await self._run(run)
        finally:
            if self.early_end is not None:
                self.early_end.close()
                self.early_end = None
            self.heartbeat_gate.check_out("runner")
            self.heartbeat_gate.check_out("recorder")
        if len(self.queue) and not self._shutdown_requested.is_set():
            self._follow_up(run)
        self._send_status()

    def _follow_up(self, run: Run) -> None:
        """Start the next run after one that is done; after another one the queue waits."""
        if run.outcome != "done":
            self.queue.problem = f"the last run was not done ({run.text}): look at it first"
            return
        try:
            self.start_queued()
        except (RigctlError, OSError):
            self.event_bus.publish("failed", f"the queue waits: {self.queue.problem}")

    def _serve_boards(self) -> None:
        if self.early_end is not None and self.run is not None:
            self.early_end.poll(self.run.status().trials_committed, self.run.end_condition)
        super()._serve_boards()
        self._check_line()
        self.heartbeat_gate.check_in("pipeline")

    def _check_disk(self) -> None:
        super()._check_disk()
        self.manual.check(self._now_s())
        if self.run is not None and not self.run.ended and self.run.disk_monitor.recorder_works:
            self.heartbeat_gate.check_in("recorder")

    def _check_line(self) -> None:
        """Pause a run while the taxels' line loses too many samples for its trials."""
        monitor, pipeline = self._line_monitor, self.boards.pipeline
        monitor.update(self._now_s(), pipeline.sample_count, pipeline.gap_count)
        if self.run is None or self.run.ended:
            return
        was_paused = NOISE in self.run.control.reasons
        is_noisy = monitor.must_pause(was_paused)
        if is_noisy and not was_paused:
            text = (
                f"{self.rig.taxels.link.name}: {100 * monitor.lost_share:.1f} % of the samples are "
                "lost on the link: look at the taxel board's cable, its length, and what runs "
                "beside it (motor wires), try another port without a hub"
            )
            self.event_bus.publish("link", text, board=TAXELS)
        self._mark_link(NOISE, not is_noisy)

    def _is_recorded(self, run: Run) -> bool:
        return self.boards.pipeline.is_recording and run.disk_monitor.grows

    def _samples_failed(self, fault: RigFault) -> None:
        """End the run as failed, and then the engine: what failed once is not called again."""
        if self.run is None or self._run_task is None or self.run.ended:
            self.shut_down(str(fault))
            return
        self._fail_run(fault)
        self._run_task.add_done_callback(lambda _: self.shut_down(str(fault)))

    def _link_changed(self) -> None:
        self._mark_link(LINK, self.boards.connected)

    async def _make_safe(self) -> None:
        if self.manual.is_recording:
            self.manual.end()
        if len(self.queue):
            self.event_bus.publish("lost", f"the engine ends, and its queue: {self.queue.names}")
        await self.calibration.measurement.end()
        if self.boards.drum_poller.connected and self.boards.drum_poller.state is not None:
            await self.boards.motion.disarm()

    def _disconnect(self) -> None:
        self.rig.drum.close()
        self.rig.taxels.close()
        if self.rig.axis is not None:
            self.rig.axis.close()
        super()._disconnect()
