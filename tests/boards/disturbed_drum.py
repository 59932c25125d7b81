"""The drum's driver behind a line that loses, repeats, delays and damages replies."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import numpy as np

from rigctl.boards.drum import Drum
from rigctl.boards.drum_codes import Command
from rigctl.errors import LinkLost
from rigctl.values import DrumState
from tests.boards.disturbance import Disturbance
from tests.boards.disturbed_boards import Judgement
from tests.boards.memory_link import JumpingLoop, LoadCellBoard, MemoryLink, run

PERIOD_S = 0.05
LATE_S = 0.07
"""A reply so late comes behind the one to the repeated request: both have changed places."""
REPEAT_S = 0.004
SYNC_EVERY_US = 70_000
LONG_PAUSE_S = 0.4


class _Line(MemoryLink):
    """A cable that disturbs what the board says."""

    def __init__(self, loop: JumpingLoop, how: Disturbance, rng: np.random.Generator) -> None:
        super().__init__(loop)
        self.how = how
        self.sent_bytes = self.frames = 0
        self._rng = rng

    def say(self, data: bytes, after_s: float = 0.0) -> None:
        self.frames += 1
        self.sent_bytes += len(data)
        drop, repeat, swap, flip = self._rng.random(4).tolist()
        if drop < self.how.drops:
            return
        if flip < self.how.flips:
            hit = bytearray(data)
            hit[int(self._rng.integers(len(hit)))] ^= 1 << int(self._rng.integers(8))
            data = bytes(hit)
        after_s += LATE_S if swap < self.how.swaps else 0.0
        super().say(data, after_s)
        if repeat < self.how.repeats:
            super().say(data, after_s + REPEAT_S * float(self._rng.random()))


class _CountingBoard(LoadCellBoard):
    """Its line of sync has risen once each 70 ms."""

    def _read(self, function: int, data: bytes) -> bytes:
        now_us = round(self._loop.time() * 1e6)
        self.put("sync_count", now_us // SYNC_EVERY_US % 65_536)
        self.put("sync_rise_us", now_us // SYNC_EVERY_US * SYNC_EVERY_US % 2**32)
        return super()._read(function, data)


def run_drum(how: Disturbance, n_bytes: int, seed: int) -> Judgement:
    """Poll, set and command a drum until it has sent ``n_bytes``, and judge what came of it."""
    rng = np.random.default_rng(seed)
    judgement = Judgement(f"drum, {how.name}")

    async def main(loop: JumpingLoop) -> None:
        line = _Line(loop, Disturbance("none"), rng)
        board, drum = _CountingBoard(loop, line), Drum(line, loop)
        await drum.connect()
        line.how = how
        states = [await drum.poll()]
        while line.sent_bytes < n_bytes:
            try:
                states.append(await drum.poll(heartbeat=bool(rng.random() < 0.8)))
                await _use(drum, board, rng, judgement)
            except LinkLost:  # five replies in a row were lost; the link is still open
                judgement.at_reboots += 1
            await asyncio.sleep(LONG_PAUSE_S if rng.random() < 0.05 else PERIOD_S)
        drum.close()
        judgement.sent_bytes, judgement.frames = line.sent_bytes, line.frames
        _judge_states(judgement, states)

    run(main)
    return judgement


async def _use(
    drum: Drum, board: LoadCellBoard, rng: np.random.Generator, judgement: Judgement
) -> None:
    """Set a value or send a command now and then; count what the board did not get."""
    what = rng.random()
    if what < 0.1:
        grams = float(rng.integers(50, 1500))
        told = await drum.set(force_set=grams)
        asked = (await drum.get("force_set"))["force_set"]
        judgement.wrong_samples += not told["force_set"] == asked == grams
    elif what < 0.2:
        before = len(board.executed)
        await (drum.stop() if what < 0.15 else drum.command(Command.ARM))
        judgement.wrong_counters += len(board.executed) != before + 1


def _judge_states(judgement: Judgement, states: list[DrumState]) -> None:
    samples = [sample for state in states for sample in state.loadcell]
    for state in states:
        rises = state.board_time_us // SYNC_EVERY_US
        right = (state.sync_count, state.sync_rise_us) == (rises, rises * SYNC_EVERY_US)
        judgement.wrong_counters += not right
    period_us = LoadCellBoard.PERIOD_US
    judgement.samples = judgement.intact = len(samples)
    judgement.wrong_samples += sum(sample.raw_counts != 10 * sample.sequence for sample in samples)
    judgement.wrong_counters += sum(
        abs(sample.board_time_us - sample.sequence * period_us) > 1 for sample in samples
    )
    numbers = [sample.sequence for sample in samples]
    judgement.wrong_counters += sum(b <= a for a, b in pairwise(numbers))
    judgement.lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    judgement.counted = sum(state.loadcell_lost for state in states)
