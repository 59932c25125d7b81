"""Record a session of the drum."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from rigctl.session.format import layout
from rigctl.session.format.data_sets import SessionLayout
from rigctl.session.format.table_rows import drum_row, trial_row
from rigctl.session.write.session_recorder import SessionRecorder
from rigctl.values import Block, DrumState, TrialRow


class Recorder(SessionRecorder):
    """Writer of one session of the drum."""

    layout: ClassVar[SessionLayout] = layout.DRUM_LAYOUT

    def begin_part(self, reason: str, texture: str) -> None:
        """Start a new file: before the first data, when resuming and at a plate change."""
        self._begin_part(reason, texture)

    def add_block(self, block: Block) -> None:
        """Record samples; if the queue is full, drop them and record a gap."""
        self._put_block(block)

    def add_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        """Record a poll, its new load-cell samples and the set-points at that time."""
        self._put(partial(self._write_drum, state, force_set_g, speed_set_mm_s))

    def commit_trial(self, row: TrialRow) -> None:
        """Record an attempt after its last sample and sync it to the medium immediately.

        The writer derives ``part`` and ``first_sample`` from the row's ``first_counter``.
        """
        self.add_trial(row)
        self._wake.set()

    def add_trial(self, row: TrialRow) -> None:
        """As :meth:`commit_trial`, but with the next flush: it does not wake the thread."""
        self._put_trial(row, partial(trial_row, row))

    def _write_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        poll = drum_row(state, force_set_g, speed_set_mm_s)
        self._writer.add_rows(layout.DRUM, state.at_s, [poll])
        # The table has the fields of a load-cell sample.
        self._writer.add_rows(layout.LOADCELL, state.at_s, state.loadcell)
