"""The virtual rig without its cables: registers are written and samples taken directly.

Mechanics, skin, load cell, state machine and force loop are those of the virtual rig. Left out
is what the bytes cost: frames, Modbus, polls. So it goes many times as fast.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.wire.drum_map import Command, CommandResult
from rigctl.wire.drum_states import State
from rigctl.wire.registers import plan_writes, register, words_of
from rigctl.world.bench import Bench
from rigctl.world.drum_tables import TENDED
from rigctl.world.glances import Glance, glances, shot_of
from rigctl.world.parameters import WorldParameters
from rigctl.world.press_kernel import DONE, SETTLED_NOW, SHOT_EVERY_US, STOPPED, TOUCHED
from rigctl.world.simulation import TAXELS, SimulatedLink
from rigctl.world.skin import SLOT_US
from rigctl.world.stretch import LONGEST_US
from rigctl.world.virtual import VirtualRig
from rigctl.world.virtual_drum import VirtualDrum
from rigctl.world.virtual_taxels import BOOT_US, FRAME_US, VirtualTaxels

NEVER_US = 1 << 62
FOLLOW_MS = 1500
NOTHING: tuple[NDArray[np.int64], NDArray[np.int64]] = (np.zeros(0, np.int64),) * 2


class Frames(NamedTuple):
    """Frames as the board would send them: uint16 (n, 18) samples, uint8 (n,) flags, edges."""

    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]


class Conversions(NamedTuple):
    """Load-cell samples with the board's number and time, each (n,): int64, force in float64."""

    sequence: NDArray[np.int64]
    board_us: NDArray[np.int64]
    raw_counts: NDArray[np.int64]
    force_g: NDArray[np.float64]

    def where(self, chosen: NDArray[np.bool_]) -> Conversions:
        """Some of them."""
        sequence, board_us, raw_counts, force_g = self
        return Conversions(sequence[chosen], board_us[chosen], raw_counts[chosen], force_g[chosen])

    def and_then(self, later: Conversions) -> Conversions:
        """These, then those."""
        return Conversions(
            np.concatenate([self.sequence, later.sequence]),
            np.concatenate([self.board_us, later.board_us]),
            np.concatenate([self.raw_counts, later.raw_counts]),
            np.concatenate([self.force_g, later.force_g]),
        )


class TaxelTap(VirtualTaxels):
    """The taxel board with its samples taken by number, at most 2 s after they were felt."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench, SimulatedLink(TAXELS))
        self.next_us = NEVER_US

    @property
    def frame_us(self) -> float:
        """Length of a frame in world time."""
        return self._frame_us

    def frame_at(self, at_us: float) -> int:
        """Number of the first frame that starts at or after a world time."""
        return int(np.ceil((at_us - BOOT_US) / self._frame_us))

    def start_us(self, frame: int) -> float:
        """World time at which a frame starts."""
        return BOOT_US + frame * self._frame_us

    def complete(self, now_us: int) -> int:
        """How many frames have ended by a world time."""
        return int((now_us - BOOT_US) / self._frame_us)

    def take(self, first: int, behind: int) -> Frames:
        """Frames ``first`` … ``behind - 1``; in rising order, each once, felt already."""
        numbers = np.arange(first, behind, dtype=np.int64)
        starts: NDArray[np.float64] = BOOT_US + numbers.astype(np.float64) * self._frame_us
        self._bench.skin.advance()
        slot_us = SLOT_US * self._frame_us / FRAME_US
        samples = self._bench.skin.read(first, starts, slot_us)
        return Frames(samples, *self._edges(starts + self._frame_us))

    def skip_marks(self, before_us: int) -> None:
        """Count the index marks before a world time, but show none of them in a frame."""
        passed = sum(at_us < before_us for at_us in self._marks)
        del self._marks[:passed]
        self._marks_before += passed


class DirectRig(VirtualRig):
    """One bench with the virtual drum's registers at hand. The same for a seed and calls.

    The drum never misses its computer: the rig beats by itself. ``helper`` may make noise ahead
    of its time.

    Raises WrongUse when a parameter lies outside its plausible range.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, helper: Executor | None = None
    ) -> None:
        bench = Bench(parameters, seed, helper)
        self.tap = TaxelTap(bench)
        super().__init__(bench, self.tap)
        self.parameters = parameters
        self.board: VirtualDrum = self._drum
        self._eventful = False
        self._polls: list[Glance] = []
        self._sequence = 0
        self._converted = [NOTHING]

    @property
    def state(self) -> State:
        """State of the drum."""
        return self.board.controller.state

    @property
    def result(self) -> CommandResult:
        """What became of the last command."""
        return CommandResult(self.board.controller.result)

    def set(self, **values: float) -> None:
        """Write settings in engineering units. Raises WrongUse for one out of its bounds."""
        for write in plan_writes(values):
            self.board.registers.write(write.address, write.words)

    def setting(self, name: str) -> float:
        """A setting in engineering units."""
        return self.board.registers.settings[name] * register(name).scale

    def command(self, command: Command) -> bool:
        """Give a command; False where the drum refuses it."""
        self._sequence = self._sequence % 65535 + 1
        entries = register("command"), register("command_sequence")
        words = [*words_of(entries[0], command), *words_of(entries[1], self._sequence)]
        answer = self.board.registers.write(entries[0].address, words)
        return answer.name == "OK"

    def watch(self) -> None:
        """Poll every :data:`press_kernel.SHOT_EVERY_US` from now on, for :meth:`polls`."""
        self._stretch.shot_us = self.time_us + SHOT_EVERY_US

    def unwatch(self) -> None:
        """Poll no more."""
        self._stretch.shot_us = math.inf

    def polls(self) -> list[Glance]:
        """Polls since the last call, oldest first. Watch, then look here after each move."""
        if self._stretch.shot_us <= self.time_us:
            self._stretch.shot_us += SHOT_EVERY_US
            self._polls.append(self.poll())
        polls, self._polls = self._polls, []
        return polls

    def poll(self) -> Glance:
        """What a poll of the drum would show now."""
        return glances(self.board, [shot_of(self.board, self.time_us)])[0]

    def pass_steps(self, step_us: int, most: int) -> None:
        """Let whole steps of time pass: until something happened in one, at most so many."""
        start_us, end_us = self.time_us, self.time_us + most * step_us
        self._eventful = False
        while self._go_on(end_us):
            if self._eventful:
                passed_us = max(self.time_us, self._bench.plant.time_ms * 1000) - start_us
                end_us = min(end_us, start_us + max(1, -(-passed_us // step_us)) * step_us)

    def _go_on(self, until_us: int) -> bool:
        """As ever, but load-cell conversions up to the next other event at once."""
        self.board.beat()
        if not self._stretch.possible:
            self._eventful = True
            return self._pass_event(until_us)
        self._follow()
        brain = self.board.controller
        next_us = min(brain.waits.next_us_without(TENDED), brain.turner.motion.next_us)
        last_us = int(min(until_us, next_us - 1, self.time_us + LONGEST_US))
        news = self._pass(last_us)
        if news == DONE and last_us < until_us and last_us < next_us - 1:
            return True
        self._eventful = self._eventful or news != DONE or next_us <= until_us
        return True if news & (STOPPED | TOUCHED | SETTLED_NOW) else self._pass_event(until_us)

    def _pass(self, until_us: int) -> int:
        """Run a stretch, noting its conversions and polls; why it ended."""
        news = super()._pass(until_us)
        self._converted.append((self._stretch.raws, self._stretch.board_us))
        if self._stretch.shots:
            self._polls += glances(self.board, self._stretch.shots)
        self.board.beat()
        return news

    def _follow(self) -> None:
        """Let skin and truth catch up before the ring of the plant is over."""
        if self._bench.plant.time_ms - self._bench.logged_ms > FOLLOW_MS:
            self._bench.log_truth()

    def conversions(self) -> Conversions:
        """Load-cell samples since the last call, oldest first. Times are not wrapped."""
        cell = self.board.controller.cell
        raws = np.concatenate([raws for raws, _ in self._converted])
        board_us = np.concatenate([board_us for _, board_us in self._converted])
        self._converted = [NOTHING]
        sequence = np.arange(cell.sequence + 1 - raws.size, cell.sequence + 1)
        force_g = (raws - cell.tare_counts) * cell.ug_per_count * 1e-6
        return Conversions(sequence, board_us, raws, force_g)

    def _convert(self, at_us: int) -> None:
        """One conversion as the boards do it, noted."""
        cell = self.board.controller.cell
        before = cell.sequence
        super()._convert(at_us)
        if cell.sequence > before:
            self._converted.append((np.array([cell.newest]), np.array([cell.newest_us])))
