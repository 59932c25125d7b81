"""The virtual rig without its cables: registers are written and samples taken directly.

Bench and firmware are those of the virtual rig. Left out is what the bytes cost: frames, Modbus,
a host that polls. So it goes many times as fast.
"""

from __future__ import annotations

from concurrent.futures import Executor
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import BoardFault
from rigctl.wire.drum_map import POLL_BLOCK, Command, CommandResult, Status
from rigctl.wire.drum_poll import later
from rigctl.wire.drum_states import Fault, State
from rigctl.wire.registers import BlockLayout, plan_writes, register, words_of
from rigctl.world.bench import LOG_EVERY_MS, Bench
from rigctl.world.drum_bench import NOMINAL_HZ, Conversions, DrumBench, Polls
from rigctl.world.host_drum import DONE
from rigctl.world.parameters import WorldParameters
from rigctl.world.truth import Truth
from rigctl.world.virtual_taxels import VirtualTaxels

POLL_MS = 100
CYCLES_PER_US = NOMINAL_HZ // 1_000_000
LAYOUT = BlockLayout(*POLL_BLOCK)
_ANGLE, _SPEED, _FORCE = (register(name).scale for name in ("angle", "speed", "force"))
_U16, _U32 = 1 << 16, 1 << 32


class Poll(NamedTuple):
    """What a poll shows. ``at_us`` is world time, the others the board's own, not wrapped;
    ``sequence`` counts the load-cell samples since its boot."""

    at_us: int
    board_time_us: int
    state: int
    fault: int
    fault_bits: int
    steps: int
    angle_deg: float
    speed_mm_s: float
    force_g: float
    actuator_position_um: int
    actuator_drive_permille: int
    sync_count: int
    sync_rise_us: int
    sync_fall_us: int
    index_count: int
    status_bits: int
    sequence: int

    @property
    def sync_high(self) -> bool:
        """The trial window is open."""
        return bool(self.status_bits >> Status.SYNC_HIGH & 1)


class Samples(NamedTuple):
    """Load-cell samples with the board's number and time, each (n,): int64, force in float64."""

    sequence: NDArray[np.int64]
    board_us: NDArray[np.int64]
    raw_counts: NDArray[np.int64]
    force_g: NDArray[np.float64]

    def where(self, chosen: NDArray[np.bool_]) -> Samples:
        """Some of them."""
        sequence, board_us, raw_counts, force_g = self
        return Samples(sequence[chosen], board_us[chosen], raw_counts[chosen], force_g[chosen])

    def and_then(self, later: Samples) -> Samples:
        """These, then those."""
        return Samples(
            np.concatenate([self.sequence, later.sequence]),
            np.concatenate([self.board_us, later.board_us]),
            np.concatenate([self.raw_counts, later.raw_counts]),
            np.concatenate([self.force_g, later.force_g]),
        )


class DirectRig:
    """One bench with the virtual drum's registers at hand. The same for a seed and calls.

    The drum never misses its computer: the board's own beats. ``helper`` may make noise ahead
    of its time.

    Raises WrongUse when a parameter lies outside its plausible range, RigFault where a board's
    library cannot be used.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, helper: Executor | None = None
    ) -> None:
        self.parameters = parameters
        self._bench = Bench(parameters, seed, helper)
        self._drum = DrumBench(self._bench)
        self._board = self._drum.board
        self._board.exchange.attended = 1
        self.taxels = VirtualTaxels(self._bench)
        self._drum.on_mark = self.taxels.mark_edge
        self._bench.on_sync = self.taxels.sync_edge
        self._command_sequence = 0
        self._polls: list[Poll] = []
        self._conversions: list[Conversions] = []
        self._taken = self._told = 0
        self._sync_count = self._index_count = 0

    @property
    def time_us(self) -> int:
        """World time."""
        return self._drum.time_ms * 1000

    @property
    def truth(self) -> Truth:
        """What really happened, up to now."""
        return self._bench.truth

    @property
    def state(self) -> State:
        """State of the drum."""
        return State(self._board.exchange.state)

    @property
    def fault(self) -> Fault:
        """The drum's latched fault."""
        return Fault(self._board.exchange.fault)

    @property
    def result(self) -> CommandResult:
        """What became of the last command."""
        return CommandResult(self._board.exchange.result)

    @property
    def sync_count(self) -> int:
        """Trial windows since the drum's boot."""
        self._sync_count = later(self._sync_count, int(self.get("sync_count")), _U16)
        return self._sync_count

    def world_us(self, board_us: int) -> float:
        """World time of a time of the drum's board."""
        exchange = self._board.exchange
        return self._drum.us(board_us * CYCLES_PER_US + exchange.booted)

    def set_plate(self, name: str) -> None:
        """Snap in a plate. Raises WrongUse for a name that is not in the catalogue."""
        self._bench.set_plate(name)

    def set(self, **values: float) -> None:
        """Write settings in engineering units.

        Raises WrongUse for one out of its bounds, BoardFault where the board refuses it.
        """
        for write in plan_writes(values):
            if self._board.write(write.address, write.words) != DONE:
                names = ", ".join(write.names)
                raise BoardFault(f"the simulated drum refused {names} in {self.state.name}")

    def get(self, name: str) -> float:
        """A register in engineering units."""
        layout = _layout_of(name)
        return layout.values(self._board.read(layout.address, layout.count))[name]

    def command(self, command: Command) -> bool:
        """Give a command; False where the drum refuses it."""
        self._command_sequence = self._command_sequence % 65535 + 1
        entries = register("command"), register("command_sequence")
        words = [*words_of(entries[0], command), *words_of(entries[1], self._command_sequence)]
        return self._board.write(entries[0].address, words) == DONE

    def pass_time(self, until_us: int, stop_on_change: bool = True) -> None:
        """Let time pass, in whole milliseconds, until then or until the drum's state, fault or
        result changed."""
        changes = self._board.exchange.changes
        while self.time_us + 1000 <= until_us:
            until_ms = min(until_us // 1000, self._drum.time_ms + LOG_EVERY_MS)
            self._drum.run(until_ms, stop_on_change)
            self._note()
            if stop_on_change and self._board.exchange.changes != changes:
                return

    def watch(self) -> None:
        """Poll every :data:`POLL_MS` from now on, for :meth:`polls`."""
        self._drum.poll_every(POLL_MS, self._drum.time_ms + POLL_MS)

    def unwatch(self) -> None:
        """Poll no more."""
        self._drum.poll_every(0, 0)

    def polls(self) -> list[Poll]:
        """Polls since the last call, oldest first."""
        polls, self._polls = self._polls, []
        return polls

    def samples(self) -> Samples:
        """Load-cell samples since the last call, oldest first. Times are not wrapped."""
        noted, self._conversions = self._conversions, []
        cycles = np.concatenate([np.zeros(0, np.int64), *(part.cycles for part in noted)])
        counts = np.concatenate([np.zeros(0, np.int64), *(part.counts for part in noted)])
        first, self._told = self._told + 1, self._told + counts.size
        sequence = np.arange(first, first + counts.size, dtype=np.int64)
        force_g = (counts - self.get("tare_counts")) * self.get("scale_ug_per_count") * 1e-6
        return Samples(sequence, self._drum.board_us(cycles), counts, force_g)

    def close(self) -> None:
        """Free the boards."""
        self._board.close()
        self.taxels.board.close()

    def _note(self) -> None:
        """Keep what came of a run."""
        conversions, polls = self._drum.conversions(), self._drum.polls()
        if polls.at_ms.size:
            self._polls += self._read(polls)
        self._conversions.append(conversions)
        self._taken += conversions.counts.size

    def _read(self, polls: Polls) -> list[Poll]:
        rows = zip(polls.words.tolist(), polls.at_ms.tolist(), polls.taken.tolist(), strict=True)
        return [self._poll(LAYOUT.raw(words), at_ms, taken) for words, at_ms, taken in rows]

    def _poll(self, raw: dict[str, tuple[int, ...]], at_ms: int, taken: int) -> Poll:
        cycle = np.array([self._drum.cycle(at_ms * 1000)])
        now_us = int(self._drum.board_us(cycle)[0])
        self._sync_count = later(self._sync_count, raw["sync_count"][0], _U16)
        self._index_count = later(self._index_count, raw["index_count"][0], _U16)
        return Poll(
            at_us=at_ms * 1000,
            board_time_us=now_us,
            state=raw["state"][0],
            fault=raw["fault"][0],
            fault_bits=raw["fault_bits"][0],
            steps=raw["steps"][0],
            angle_deg=raw["angle"][0] * _ANGLE,
            speed_mm_s=raw["speed"][0] * _SPEED,
            force_g=raw["force"][0] * _FORCE,
            actuator_position_um=raw["actuator_position_um"][0],
            actuator_drive_permille=raw["actuator_drive"][0],
            sync_count=self._sync_count,
            sync_rise_us=now_us - (now_us - raw["sync_rise_us"][0]) % _U32,
            sync_fall_us=now_us - (now_us - raw["sync_fall_us"][0]) % _U32,
            index_count=self._index_count,
            status_bits=raw["status_bits"][0],
            sequence=self._taken + taken,
        )


@cache
def _layout_of(name: str) -> BlockLayout:
    entry = register(name)
    return BlockLayout(entry.address, entry.words * entry.count, [entry])
