"""What is recorded of the world: stretches around the trials, laid end to end.

Between two stretches the session's time stands still: sample counter, loop time, the drum's
clock and the world's own log all leave out the same whole number of frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from rigctl.session.files.ground_truth import TruthLog
from rigctl.simulation.direct_rig import DirectRig
from rigctl.values import Block, DrumState, LoadcellSample

LEAD_US = 110_000
"""Recorded before the rise of sync; longer than a step, so that a poll lies in it."""

SEAM_US = 2_000
"""Polls so near to the start of a stretch are left out: they could lie before the last one's."""

POLLS_KEPT = 3


class TrialRecording:
    """Records one stretch at a time; ``on_block`` and ``on_drum`` get what is recorded."""

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
        self._clock = 1.0 + rig.parameters.drum_clock_ppm * 1e-6
        self._next_frame = 0
        self._skipped_frames = 0
        self._polls: list[DrumState] = []
        self._conversions = 0
        self._edges_us = [0, 0]
        self._start_us = 0.0
        self._truth_rows = 0

    @property
    def now_s(self) -> float:
        """Session time up to which there are samples."""
        return self._recorded_us(self._taxels.start_us(self._next_frame)) * 1e-6

    def listen(self, poll: DrumState) -> None:
        """While no stretch is recorded: keep the newest polls, one may begin the next."""
        self._polls = [*self._polls[1 - POLLS_KEPT :], poll]

    def begin(self, at_us: float) -> None:
        """A stretch begins ``LEAD_US`` before this world time, which is less than 2 s ago."""
        first = max(self._next_frame, self._taxels.frame_at(at_us - LEAD_US))
        self._skipped_frames += first - self._next_frame
        self._next_frame = first
        self._start_us = self._taxels.start_us(first)
        polls, self._polls = self._polls, []
        self._tell(polls)

    def follow(self, polls: Sequence[DrumState]) -> None:
        """Record these polls, and samples up to the last of them."""
        behind = self._taxels.complete(polls[-1].at_s * 1e6)
        samples, flags, edges = self._taxels.take(self._next_frame, behind)
        numbers = np.arange(self._next_frame, behind, dtype=np.int64) - self._skipped_frames
        self._next_frame = behind
        at_s = self._recorded_us(polls[-1].at_s * 1e6) * 1e-6
        self._on_block(Block(numbers, samples, flags, edges, (), at_s))
        self._tell(polls)

    def end(self) -> TruthLog:
        """The stretch ends with the last :meth:`follow`; what the world logged meanwhile."""
        log = self._rig.truth.take()
        shift_ms = round(self._skipped_frames * self._taxels.frame_us / 1000)
        first, behind = self._truth_rows, int(self.now_s * 1000)
        self._truth_rows = behind
        rows = slice(first + shift_ms - log.first_ms, behind + shift_ms - log.first_ms)
        return first, log.speed_mm_s[rows], log.force_g[rows], log.sync[rows]

    def _recorded_us(self, world_us: float) -> float:
        return world_us - self._skipped_frames * self._taxels.frame_us

    def _recorded_board_us(self, board_us: int) -> int:
        return math.floor(board_us - self._skipped_board_us)

    @property
    def _skipped_board_us(self) -> float:
        return self._skipped_frames * self._taxels.frame_us * self._clock

    def _tell(self, polls: Sequence[DrumState]) -> None:
        """Show the polls of this stretch, with the load-cell samples that lie in it."""
        for poll in polls:
            if poll.at_s * 1e6 >= self._start_us + SEAM_US:
                self._on_drum(self._shown(poll))

    def _shown(self, poll: DrumState) -> DrumState:
        rise_us, fall_us = self._edges(poll)
        return replace(
            poll,
            at_s=self._recorded_us(poll.at_s * 1e6) * 1e-6,
            board_time_us=self._recorded_board_us(poll.board_time_us),
            sync_rise_us=rise_us,
            sync_fall_us=fall_us,
            loadcell=tuple(self._weighed(poll.loadcell)),
            loadcell_lost=0,
            values={},
        )

    def _edges(self, poll: DrumState) -> list[int]:
        """Session times of the last edges; those before this stretch stay where they were."""
        for place, at_us in enumerate((poll.sync_rise_us, poll.sync_fall_us)):
            if at_us >= self._start_us * self._clock:
                self._edges_us[place] = self._recorded_board_us(at_us)
        return self._edges_us

    def _weighed(self, samples: Sequence[LoadcellSample]) -> Iterator[LoadcellSample]:
        """Those of this stretch, with numbers and times of the session."""
        first_us, out_us = (self._start_us + SEAM_US) * self._clock, self._skipped_board_us
        for _, at_us, counts, force_g in samples:
            if at_us >= first_us:
                self._conversions += 1
                yield LoadcellSample(self._conversions, math.floor(at_us - out_us), counts, force_g)
