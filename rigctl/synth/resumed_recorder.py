"""Where a world that is run again records: only what its session does not hold yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.session.write.recorder import Recorder, RecorderStatus
from rigctl.values import Block, DrumState, Event, TrialRow


class ResumedRecorder:
    """A recorder that takes nothing until so many attempts have gone by: they are on disk.

    ``wiring``: the reading that stands at each place; blocks come as the wire has them.
    """

    def __init__(self, recorder: Recorder, attempts: int, wiring: Sequence[int]) -> None:
        self._recorder = recorder
        self._order = np.array(wiring, np.intp)
        self._to_come = attempts
        self._texture = ""

    @property
    def status(self) -> RecorderStatus:
        """The recorder's."""
        return self._recorder.status

    def begin_part(self, reason: str, texture: str) -> None:
        """A new file, unless it is there already."""
        self._texture = texture
        if not self._to_come:
            self._recorder.begin_part(reason, texture)

    def add_block(self, block: Block) -> None:
        """Samples."""
        if not self._to_come:
            placed = np.ascontiguousarray(block.samples[:, self._order])
            self._recorder.add_block(replace(block, samples=placed))

    def add_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        """A poll."""
        if not self._to_come:
            self._recorder.add_drum(state, force_set_g, speed_set_mm_s)

    def add_event(self, event: Event) -> None:
        """An event."""
        if not self._to_come:
            self._recorder.add_event(event)

    def commit_trial(self, row: TrialRow) -> None:
        """How an attempt ended; behind the last known one the session goes on in a new part."""
        if not self._to_come:
            self._recorder.add_trial(row)
            return
        self._to_come -= 1
        if not self._to_come:
            self._recorder.begin_part("resume", self._texture)

    def wait_written(self) -> None:
        """Wait until all is on the medium."""
        self._recorder.wait_written()
