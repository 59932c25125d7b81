"""A run as its engine sees it: one sitting of one plan, and the end of its session."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from rigctl.engine.copy_process import CopyProcess
from rigctl.engine.event_bus import EventBus
from rigctl.engine.health import DiskMonitor
from rigctl.engine.rpc.messages import DISK_ERROR, RecordingStatus
from rigctl.engine.run_reasons import SESSION_OUTCOMES, RunReasons
from rigctl.engine.streams_process import StreamsProcess
from rigctl.session.extra_stream import STREAM_KIND
from rigctl.session.recorder import SessionRecorder

_Control = TypeVar("_Control", bound=RunReasons)
_Recorder = TypeVar("_Recorder", bound=SessionRecorder)


class ServedRun(ABC, Generic[_Control, _Recorder]):
    """One sitting of one plan, controlled through ``control``.

    ``outcome``: done, aborted or failed, empty before the end; ``text``: a sentence on it.
    ``missing``: sentences on what earlier sittings lack.
    """

    def __init__(
        self, control: _Control, recorder: _Recorder, event_bus: EventBus, missing: Iterable[str]
    ) -> None:
        self.control = control
        self.disk_monitor = DiskMonitor(recorder)
        self.copy: CopyProcess | None = None
        """What copies the session to a second disk, if something does."""
        self.streams: StreamsProcess | None = None
        """What records the streams of other programs beside the session, if something does."""
        self.outcome = ""
        self.text = ""
        self._recorder = recorder
        self._event_bus = event_bus
        self._missing = tuple(missing)

    @property
    def ended(self) -> bool:
        """Whether it is over and its session closed."""
        return bool(self.outcome)

    @property
    def folder(self) -> Path:
        """The session's folder."""
        return self._recorder.folder

    @property
    def start(self) -> tuple[str, float]:
        """Wall clock and loop time at which the sitting began."""
        return self._recorder.header.start_utc, self._recorder.header.start_loop_s

    @property
    def state(self) -> str:
        """How it ended, or else running, paused or prompt."""
        if self.outcome:
            return self.outcome
        if self.control.prompt is not None:
            return "prompt"
        return "paused" if self.control.reasons else "running"

    def recording_status(self, is_recording: bool) -> RecordingStatus:
        """Return what has reached the disk; after the end nobody measures the space that is left.

        ``is_recording``: samples go to the recorder now.
        """
        found = self.disk_monitor.status(is_recording)
        return replace(found, disk_free_bytes=0, hours_left=None) if self.ended else found

    @abstractmethod
    def status(self) -> Any:
        """Return the run's part of the status message."""

    async def execute(self) -> None:
        """Run the plan; faults end the run and are published, not raised."""
        outcome = "failed"
        try:
            with self._recording():
                for line in self._missing:
                    self._event_bus.publish("log", line)
                outcome, text = await self._run_plan()
        finally:
            if self._recorder.status.part == 0:
                self._recorder.begin_part("nothing was recorded")
            if self.streams is not None:
                self._record_streams(await self.streams.finish())
            self._record_end()
            self._recorder.close(SESSION_OUTCOMES[outcome])
        if self.copy is not None:
            await self.copy.finish()
        if self._recorder.failure is not None and outcome == "done":
            outcome, text = "failed", self._recorder.failure
        self.outcome, self.text = outcome, text
        data = {"session": str(self.folder), "digest": self._recorder.closing_digest}
        self._event_bus.publish("run", text, state=outcome, **data)

    @abstractmethod
    def _recording(self) -> AbstractContextManager[None]:
        """Return a context in which what the rig sends goes to the recorder."""

    @abstractmethod
    async def _run_plan(self) -> tuple[str, str]:
        """Run what is left of the plan; return the outcome and a sentence on it."""

    async def _until_disk_works(self, wait: Callable[[], Awaitable[None]]) -> frozenset[int]:
        """Pause until the disk takes files again; return the trials that are committed on it.

        ``wait``: between two tries; it may raise what ends the run.
        """
        self._event_bus.publish("disk", self._recorder.failure or "the disk refused")
        self.control.pause(DISK_ERROR)
        while (on_disk := self._recorder.try_again()) is None:
            await wait()
        self.control.resume(DISK_ERROR)
        return on_disk

    def _record_streams(self, closed: Mapping[str, str]) -> None:
        """Record the last digest of each stream's file, so that the session's covers it."""
        unsubscribe = self._event_bus.subscribe(self._recorder.add_event)
        for name, digest in closed.items():
            text = f"{name} is closed beside the session"
            self._event_bus.publish(STREAM_KIND, text, file=name, digest=digest)
        unsubscribe()

    def _record_end(self) -> None:
        """Record what a session says of the rig at its end."""
