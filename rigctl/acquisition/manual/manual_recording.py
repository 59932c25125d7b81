"""Record what happens while the drum is operated by hand, into a session of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rigctl.acquisition.boards import Boards
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.health.boards import END, START
from rigctl.acquisition.health.disk import DiskMonitor
from rigctl.session.layout import SessionOutcome
from rigctl.session.recorder import Recorder
from rigctl.values import DrumState

DISK_FULL = "the disk is full: the recording has ended, and all of it is kept; make room"


class ManualRecording:
    """One recording: samples, polls and events from its making until :meth:`close`."""

    def __init__(
        self, boards: Boards, event_bus: EventBus, recorder: Recorder, texture: str | None
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
