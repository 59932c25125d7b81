"""Record stretches of simulated time around the trials, without gaps in session time.

Session time stops between two stretches: sample counter, loop time, the drum's clock and the ground
truth all leave out the same whole number of frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from rigctl.session.ground_truth import TruthRows
from rigctl.simulation.direct_rig import DirectRig
from rigctl.values import Block, DrumState, LoadcellSample

LEAD_US = 110_000
"""Recorded before the rise of sync; longer than the polling period, so that it contains a poll."""

SEAM_US = 2_000
"""Polls this soon after the start of a stretch are left out: they could precede earlier ones."""

POLLS_KEPT = 3


class TrialRecording:
    """Records one stretch at a time and passes it to ``on_block`` and ``on_drum``."""

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
        self._clock_rate = 1.0 + rig.parameters.drum_clock_ppm * 1e-6
        self._next_frame = 0
        self._skipped_frames = 0
        self._recent_polls: list[DrumState] = []
        self._conversions = 0
        self._edges_us = [0, 0]
        self._start_us = 0.0
        self._truth_rows = 0

    @property
    def now_s(self) -> float:
        """Session time of the end of the samples."""
        return self._session_s(self._taxels.start_us(self._next_frame))

    def buffer_poll(self, poll: DrumState) -> None:
        """Keep a poll outside of a stretch; the next stretch may begin before it."""
        self._recent_polls = [*self._recent_polls[1 - POLLS_KEPT :], poll]

    def begin(self, at_us: float) -> None:
        """Begin a stretch ``LEAD_US`` before this simulated time, which is less than 2 s ago."""
        first = max(self._next_frame, self._taxels.first_frame_from(at_us - LEAD_US))
        self._skipped_frames += first - self._next_frame
        self._next_frame = first
        self._start_us = self._taxels.start_us(first)
        polls, self._recent_polls = self._recent_polls, []
        self._record_polls(polls)

    def record(self, polls: Sequence[DrumState]) -> None:
        """Record these polls, and the samples up to the last of them."""
        end = self._taxels.ended_frames(polls[-1].at_s * 1e6)
        samples, flags, edges = self._taxels.read_frames(self._next_frame, end)
        numbers = np.arange(self._next_frame, end, dtype=np.int64) - self._skipped_frames
        self._next_frame = end
        at_s = self._session_s(polls[-1].at_s * 1e6)
        self._on_block(Block(numbers, samples, flags, edges, (), at_s))
        self._record_polls(polls)

    def end(self) -> TruthRows:
        """End the stretch at the last :meth:`record`; return its ground truth."""
        log = self._rig.truth.take()
        shift_ms = round(self._skipped_us / 1000)
        first, end = self._truth_rows, int(self.now_s * 1000)
        self._truth_rows = end
        rows = slice(first + shift_ms - log.first_ms, end + shift_ms - log.first_ms)
        return first, log.speed_mm_s[rows], log.force_g[rows], log.sync[rows]

    @property
    def _skipped_us(self) -> float:
        return self._skipped_frames * self._taxels.frame_us

    def _session_s(self, simulated_us: float) -> float:
        return (simulated_us - self._skipped_us) * 1e-6

    def _session_board_us(self, board_us: int) -> int:
        return math.floor(board_us - self._skipped_us * self._clock_rate)

    def _record_polls(self, polls: Sequence[DrumState]) -> None:
        """Record the polls that belong to this stretch."""
        for poll in polls:
            if poll.at_s * 1e6 >= self._start_us + SEAM_US:
                self._on_drum(self._in_session_time(poll))

    def _in_session_time(self, poll: DrumState) -> DrumState:
        rise_us, fall_us = self._edges(poll)
        return replace(
            poll,
            at_s=self._session_s(poll.at_s * 1e6),
            board_time_us=self._session_board_us(poll.board_time_us),
            sync_rise_us=rise_us,
            sync_fall_us=fall_us,
            loadcell=tuple(self._loadcell_samples(poll.loadcell)),
            loadcell_lost=0,
            values={},
        )

    def _edges(self, poll: DrumState) -> list[int]:
        """Return session times of the last edges; edges before this stretch keep theirs."""
        for index, at_us in enumerate((poll.sync_rise_us, poll.sync_fall_us)):
            if at_us >= self._start_us * self._clock_rate:
                self._edges_us[index] = self._session_board_us(at_us)
        return self._edges_us

    def _loadcell_samples(self, samples: Sequence[LoadcellSample]) -> Iterator[LoadcellSample]:
        """Yield the samples of this stretch, with the session's numbers and times."""
        first_us = (self._start_us + SEAM_US) * self._clock_rate
        for _, at_us, counts, force_g in samples:
            if at_us >= first_us:
                self._conversions += 1
                board_us = self._session_board_us(at_us)
                yield LoadcellSample(self._conversions, board_us, counts, force_g)
