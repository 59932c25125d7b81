"""Recording of operation by hand: a session of its own, without trials.

The part begins anew where the plate changes.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rigctl.engine.copy_process import CopyProcess
from rigctl.engine.event_bus import EventBus
from rigctl.engine.health import END, START, DiskMonitor
from rigctl.engine.rig_boards import RigBoards
from rigctl.engine.rpc.messages import RecordingStatus
from rigctl.engine.run_request import RunContext, check_disk_space, open_recorder
from rigctl.engine.streams_process import StreamsProcess
from rigctl.errors import WrongUse
from rigctl.protocol.loader import parse_protocol
from rigctl.session.layout import SessionOutcome
from rigctl.session.recorder import Recorder
from rigctl.values import DrumState

NAME = "by-hand"
NEEDED_BYTES = 10_000_000
"""Room for the first minutes; the disk is watched from then on."""


def protocol_text(note: str) -> str:
    """Return the protocol that a session by hand stores, with the operator's note."""
    told = json.dumps(note or "no note", ensure_ascii=False).replace("\x7f", "\\u007f")
    return (
        f'name = "{NAME}"\ndescription = {told}\n\n'
        '[[steps]]\nat = "start"\nkind = "message"\ntext = "operated by hand"\n'
    )


def open_manual_session(folder: Path, note: str, context: RunContext) -> Recorder:
    """Return the recorder of a new session by hand.

    Raises WrongUse where the folder is no whole path, SessionError where it holds something,
    DiskFault where it has no room.
    """
    if not folder.is_absolute():
        raise WrongUse(f"{folder} is no whole path: choose the folder to save in")
    plan = parse_protocol(protocol_text(note), NAME, context.rig.config).plan()
    check_disk_space(folder, NEEDED_BYTES)
    return open_recorder(folder, plan, context, resume=False)


BeginBeside = Callable[[Path, tuple[str, float]], tuple[CopyProcess | None, StreamsProcess | None]]
"""Starts what copies a session, and what records streams beside a sitting, from its start."""
DISK_FULL = "the disk is full: the recording has ended, and all of it is kept; make room"


class ManualRecording:
    """One recording: samples, polls and events from its making until :meth:`close`."""

    def __init__(
        self,
        boards: RigBoards,
        event_bus: EventBus,
        recorder: Recorder,
        texture: str | None,
        begin_beside: BeginBeside,
    ) -> None:
        self.disk_monitor = DiskMonitor(recorder)
        self._recorder = recorder
        self._pipeline = boards.pipeline
        self._motion = boards.motion
        self._health = boards.board_health
        self._health_before = self._health.counters()
        recorder.begin_part("operated by hand", texture or "")
        self._pipeline.set_recorder(recorder)
        self._unsubscribe: list[Callable[[], None]] = [
            boards.drum_poller.subscribe(self._add_drum),
            event_bus.subscribe(recorder.add_event),
        ]
        self._record_health(START)
        header = recorder.header
        start = header.start_utc, header.start_loop_s
        _, self.streams = begin_beside(recorder.folder, start)

    @property
    def folder(self) -> Path:
        """The session's folder."""
        return self._recorder.folder

    @property
    def must_end(self) -> str:
        """Why it cannot go on, a sentence; empty while it can."""
        if self._recorder.failure is not None:
            return self._recorder.failure
        return DISK_FULL if self.disk_monitor.must_pause(paused=False) else ""

    def change_plate(self, texture: str) -> None:
        """Begin a new part, which has another plate."""
        self._pipeline.set_recorder(None)
        self._recorder.begin_part("another plate", texture)
        self._pipeline.set_recorder(self._recorder)

    def close(self) -> str:
        """End the recording and close the session; return its digest."""
        if self.streams is not None:
            self.streams.let_go()
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        self._pipeline.set_recorder(None)
        self._record_health(END)
        self._recorder.close(SessionOutcome.FINISHED)
        return self._recorder.closing_digest

    def _add_drum(self, state: DrumState) -> None:
        settings = self._motion.settings
        self._recorder.add_drum(
            state, settings.get("force_set", 0.0), settings.get("speed_set", 0.0)
        )

    def _record_health(self, when: str) -> None:
        for event in self._health.events(when, self._health_before):
            self._recorder.add_event(event)


class ManualRecorder:
    """The recording by hand of one engine; there is one at a time."""

    def __init__(self, boards: RigBoards, event_bus: EventBus, begin_beside: BeginBeside) -> None:
        self._boards = boards
        self._begin_beside = begin_beside
        self._event_bus = event_bus
        self._recording: ManualRecording | None = None

    @property
    def is_recording(self) -> bool:
        """Whether one goes on."""
        return self._recording is not None

    def begin(self, folder: Path, note: str, context: RunContext, texture: str | None) -> Path:
        """Begin to record into a new folder; return it.

        Raises WrongUse during another recording and for a folder that is no whole path,
        SessionError where it holds something, DiskFault where it has no room.
        """
        if self._recording is not None:
            raise WrongUse(f"{self._recording.folder} is being recorded: end that first")
        recorder = open_manual_session(folder, note, context)
        self._recording = ManualRecording(
            self._boards, self._event_bus, recorder, texture, self._begin_beside
        )
        self._event_bus.publish("record", f"recording by hand: {folder}", session=str(folder))
        if note:
            self._event_bus.publish("note", note)
        return folder

    def end(self) -> Path:
        """End the recording; return its folder. Raises WrongUse without one."""
        recording, self._recording = self._recording, None
        if recording is None:
            raise WrongUse("nothing is recorded by hand: begin a recording first")
        digest = recording.close()
        self._event_bus.publish("record", f"recorded by hand: {recording.folder}", digest=digest)
        return recording.folder

    def change_plate(self, texture: str) -> None:
        """Begin a new part with another plate."""
        if self._recording is not None:
            self._recording.change_plate(texture)

    def check(self, now_s: float) -> None:
        """End a recording that the disk no longer takes; call it about ten times a second."""
        if self._recording is None:
            return
        self._recording.disk_monitor.update(now_s)
        if self._recording.streams is not None:
            self._recording.streams.tell_time(now_s)
        if reason := self._recording.must_end:
            self._event_bus.publish("disk", reason)
            self.end()

    def status(self) -> RecordingStatus | None:
        """Return the recording's part of the status message, None without one."""
        if self._recording is None:
            return None
        return replace(self._recording.disk_monitor.status(recording=True), by_hand=True)
