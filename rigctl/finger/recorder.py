"""Record a session of the moving finger."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from rigctl.errors import WrongUse
from rigctl.finger.board_messages import SampleFlag
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.layout import FINGER_LAYOUT, FingerRow, finger_row, finger_trial_row
from rigctl.finger.values import FingerSamples, FingerTrialRow
from rigctl.session.header import SessionHeader
from rigctl.session.layout import SessionLayout
from rigctl.session.recorder import SessionRecorder
from rigctl.values import Gap

LOST_BEFORE_BOARD = "lost before the finger board"
LOST_AFTER_BOARD = "lost on the finger board's line"
"""Reasons of gaps: samples that the board did not get, and frames that the host did not get."""


class FingerRecorder(SessionRecorder):
    """Writer of one session of the moving finger.

    Also raises WrongUse for a header without the reference speed of scaled time.
    """

    layout: ClassVar[SessionLayout] = FINGER_LAYOUT

    def __init__(
        self,
        folder: Path,
        header: SessionHeader,
        protocol_text: str,
        rig_text: str,
        *,
        resume: bool = False,
    ) -> None:
        if header.reference_um_per_s <= 0:
            raise WrongUse(
                f"a session of the finger needs the reference speed, not "
                f"{header.reference_um_per_s} µm/s: nothing is recorded into {folder}"
            )
        super().__init__(folder, header, protocol_text, rig_text, resume=resume)
        self._next_counter: int | None = None

    def add_samples(self, block: FingerBlock, arrived_s: float) -> None:
        """Record samples and spikes; if the queue is full, drop them and record a gap."""
        if not len(block.counters):
            return
        samples = FingerSamples(
            counters=block.counters,
            samples=block.readings,
            spikes=block.spikes,
            flags=block.flags,
            gaps=find_gaps(block, self._next_counter),
            arrived_s=arrived_s,
        )
        self._next_counter = int(block.counters[-1]) + 1
        self.add_block(samples)

    def add_row(self, row: FingerRow) -> None:
        """Record a position, a batch, a window of scaled time, an answer or a latency."""
        table, at_s, values = finger_row(row)
        self._put(partial(self._writer.add_rows, table, at_s, [values]))

    def commit_trial(self, row: FingerTrialRow) -> None:
        """Record an attempt after its last sample, batch and window, and sync it immediately.

        The writer derives ``part`` and ``first_sample`` from the row's ``first_counter``.
        """
        self._put_trial(row, partial(finger_trial_row, row))
        self._wake.set()


def find_gaps(block: FingerBlock, next_counter: int | None) -> tuple[Gap, ...]:
    """Return the samples that are missing before and inside a block.

    ``next_counter`` follows the sample before the block, None without one. A counter below it is
    that of a board that restarted, and no gap.
    """
    first = int(block.counters[0])
    before = first - 1 if next_counter is None else min(next_counter, first) - 1
    steps = np.diff(block.counters, prepend=before)
    return tuple(
        Gap(int(block.counters[at] - steps[at]) + 1, int(steps[at]) - 1, _reason(block.flags[at]))
        for at in np.flatnonzero(steps > 1)
    )


def _reason(flags: int) -> str:
    return LOST_BEFORE_BOARD if flags & SampleFlag.LOST_BEFORE else LOST_AFTER_BOARD
