"""Begins and ends recordings by hand, and ends one that cannot go on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rigctl.acquisition.boards import Boards
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.manual.manual_recording import ManualRecording
from rigctl.acquisition.manual.manual_session import open_manual_session
from rigctl.acquisition.protocol.run_request import RunContext
from rigctl.acquisition.rpc.messages import RecordingStatus
from rigctl.errors import WrongUse


class ManualRecorder:
    """The recording by hand of one engine; there is one at a time."""

    def __init__(self, boards: Boards, event_bus: EventBus) -> None:
        self._boards = boards
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
        self._recording = ManualRecording(self._boards, self._event_bus, recorder, texture)
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
        if reason := self._recording.must_end:
            self._event_bus.publish("disk", reason)
            self.end()

    def status(self) -> RecordingStatus | None:
        """Return the recording's part of the status message, None without one."""
        if self._recording is None:
            return None
        return replace(self._recording.disk_monitor.status(recording=True), by_hand=True)
