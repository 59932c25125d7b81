"""Cut trials out of the taxel samples at the rise of the sync line, exact to the sample.

Every frame counts the rises modulo 4, so a rise is known even when the frame in which it fell
was lost. A trial's first sample is the first frame that starts after the rise, which is the one
after the frame in which the count changed; its length is a number of samples, not an edge.

Without a sync wire the drum's clock gives the first sample a little later: the cutter buffers the
blocks that arrive meanwhile and cuts them then.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import Flag
from rigctl.config.rig_config import ADC_MAX
from rigctl.session.data_quality import BASELINE_SAMPLES
from rigctl.session.trial_sums import TrialSums
from rigctl.values import Block

BUFFERED_BLOCKS = 100
"""At least two seconds, as a block has 20 samples or more; a poll reports a rise within 0.1 s."""
_RISES = np.uint8(0b11)


@dataclass(slots=True)
class CutTrial:
    """Statistics of one trial's samples.

    ``first_counter``: board counter of its first sample. ``received`` of ``n_samples`` arrived;
    ``late`` and ``overrun`` count samples with these flags, ``sync_low`` those outside the window
    in which the drum signals a constant speed. ``longest_gap``: most missing samples in a row.
    ``start_lost``: the rise fell into a gap, so the first sample may be another one, or it is
    missing. ``by_wire``: cut at the sync line, which alone shows ``sync_low``. ``sums``: over the
    readings of its taxels, None before the first.
    """

    first_counter: int
    n_samples: int
    received: int = 0
    late: int = 0
    overrun: int = 0
    sync_low: int = 0
    newest_counter: int = -1
    longest_gap: int = 0
    start_lost: bool = False
    by_wire: bool = True
    sums: TrialSums | None = field(default=None, compare=False)

    @property
    def complete(self) -> bool:
        """Whether the last sample, or one after it, has arrived."""
        return self.newest_counter >= self.first_counter + self.n_samples - 1


class TrialCutter:
    """Follows the samples and cuts the expected trial."""

    def __init__(self, full_scale: int = ADC_MAX) -> None:
        self.trial: CutTrial | None = None
        self._full_scale = full_scale
        self._expected_samples: int | None = None
        self._last_rises: np.uint8 | None = None
        self._next_counter = -1
        self._buffered: list[Block] | None = None
        self._lifted: TrialSums | None = None
        self._is_lifted = False
        # Loads the compiled kernel now: in a trial it would delay a heartbeat.
        TrialSums(1).add(np.zeros((1, 1), np.uint16))

    @property
    def baseline(self) -> NDArray[np.float64] | None:
        """Mean readings before the last approach, None before they arrived."""
        return None if self._lifted is None else self._lifted.mean

    def expect(self, n_samples: int, by_wire: bool = True, *, is_lifted: bool = True) -> None:
        """Cut a trial of this length at the next rise, or without the wire at :meth:`begin`.

        The next readings of a lifted drum are taken for the baseline; in contact that of the last
        approach holds.
        """
        self.trial = None
        self._is_lifted = is_lifted
        if is_lifted:
            self._lifted = None
        self._expected_samples = n_samples
        self._buffered = None if by_wire else []

    def begin(self, first_counter: int) -> None:
        """Begin the expected trial at a sample of a short while ago."""
        assert self._expected_samples is not None and self._buffered is not None
        self.trial = CutTrial(first_counter, self._expected_samples, by_wire=False)
        buffered, self._expected_samples, self._buffered = self._buffered, None, None
        for block in buffered:
            self._add_to_trial(block)

    def cancel(self) -> None:
        """Drop the cut trial and expect none."""
        self.trial = None
        self._expected_samples = None
        self._buffered = None

    def reset(self) -> None:
        """Cancel and drop the counters: those of the board restarted."""
        self.cancel()
        self._last_rises = None
        self._next_counter = -1

    def add_block(self, block: Block) -> list[int]:
        """Add one block; return the board counters of the first samples after each rise.

        A counter directly after the block's last one belongs to the next block.
        """
        if self._buffered is not None:
            self._buffered = [*self._buffered[-BUFFERED_BLOCKS:], block]
        rises = block.edges & _RISES
        rows = self._find_rises(rises)
        if rows and self._expected_samples is not None and self._buffered is None:
            self._begin_at_rise(block, rows[0], self._expected_samples)
        self._add_to_trial(block)
        self._add_to_baseline(block)
        self._last_rises, self._next_counter = rises[-1], int(block.counters[-1]) + 1
        return [int(block.counters[row]) + 1 for row in rows]

    def _find_rises(self, rises: NDArray[np.uint8]) -> list[int]:
        """Return the rows at which the number of rises modulo 4 differs from the row before."""
        before = rises[0] if self._last_rises is None else self._last_rises
        if (rises == before).all():  # almost always
            return []
        return list(np.flatnonzero(np.diff(rises, prepend=before)))

    def _begin_at_rise(self, block: Block, row: int, n_samples: int) -> None:
        """Begin the expected trial with the sample after this row."""
        counter = int(block.counters[row])
        expected = int(block.counters[row - 1]) + 1 if row else self._next_counter
        self.trial = CutTrial(counter + 1, n_samples, start_lost=counter != expected)
        self._expected_samples = None

    def _add_to_trial(self, block: Block) -> None:
        trial = self.trial
        if trial is None or trial.complete:
            return
        start, stop = np.searchsorted(
            block.counters, (trial.first_counter, trial.first_counter + trial.n_samples)
        )
        self._add_gaps(trial, block.counters[start : stop + 1])
        flags = block.flags[start:stop]
        if stop > start:
            trial.sums = trial.sums or TrialSums(block.samples.shape[1], self._full_scale)
            trial.sums.add(block.samples[start:stop])
        trial.received += len(flags)
        trial.late += _count(flags, Flag.LATE)
        trial.overrun += _count(flags, Flag.OVERRUN)
        if trial.by_wire:
            trial.sync_low += len(flags) - _count(flags, Flag.SYNC)
        trial.newest_counter = int(block.counters[-1])

    def _add_to_baseline(self, block: Block) -> None:
        if not self._is_lifted or self._expected_samples is None or self.trial is not None:
            return
        self._lifted = self._lifted or TrialSums(block.samples.shape[1], self._full_scale)
        if missing := BASELINE_SAMPLES - self._lifted.n:
            self._lifted.add(block.samples[:missing])

    def add_spikes(self, block: Block, spikes: NDArray[np.uint8]) -> None:
        """Add the spikes of a block that was added, uint8 (n, 2·n_taxels).

        Without the wire the first ones come before the trial is known: it then has no spikes.
        """
        trial = self.trial
        if trial is not None and trial.by_wire and trial.sums is not None:
            first, end = trial.first_counter, trial.first_counter + trial.n_samples
            trial.sums.add_spikes(spikes[slice(*np.searchsorted(block.counters, (first, end)))])

    def _add_gaps(self, trial: CutTrial, counters: NDArray[np.int64]) -> None:
        """Add the gaps before each of these samples; the last may be the first after the trial."""
        if not len(counters):
            return
        before = max(trial.newest_counter, trial.first_counter - 1)
        trial.start_lost |= before < trial.first_counter < int(counters[0])
        end = trial.first_counter + trial.n_samples
        if int(counters[-1]) - int(counters[0]) == len(counters) - 1:  # almost always
            lost = min(int(counters[0]), end) - before - 1
        else:
            within = np.minimum(counters, end)
            lost = int(np.diff(within, prepend=before).max()) - 1
        trial.longest_gap = max(trial.longest_gap, lost)


def _count(flags: NDArray[np.uint8], flag: Flag) -> int:
    return int(np.count_nonzero(flags & np.uint8(flag)))
