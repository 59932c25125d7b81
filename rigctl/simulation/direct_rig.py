"""The virtual rig without its cables: registers are written and samples taken directly.

Bench and firmware are those of the virtual rig. Left out is what the bytes cost: frames, Modbus,
a host that polls. So it goes many times as fast.
"""

from __future__ import annotations

from concurrent.futures import Executor
from functools import cache

from rigctl.errors import BoardFault
from rigctl.simulation.bench.bench import LOG_EVERY_MS, Bench
from rigctl.simulation.bench.ground_truth import GroundTruth
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.boards.drum_firmware import DONE
from rigctl.simulation.boards.drum_stepper import NOMINAL_HZ, DrumStepper
from rigctl.simulation.boards.taxels import VirtualTaxels
from rigctl.values import DrumState
from rigctl.wire.drum.codes import Command, CommandResult
from rigctl.wire.drum.poll import PollDecoder, RingSample
from rigctl.wire.drum.register_table import POLL_BLOCK, RING_DEPTH
from rigctl.wire.drum.registers import BlockLayout, find_register, pack_value, plan_writes
from rigctl.wire.drum.states import Fault, State

POLL_MS = 100
CYCLES_PER_US = NOMINAL_HZ // 1_000_000


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
        self._drum = DrumStepper(self._bench)
        self._board = self._drum.board
        self._board.exchange.attended = 1
        self.taxels = VirtualTaxels(self._bench)
        self._drum.on_mark = self.taxels.mark_edge
        self._bench.on_sync = self.taxels.sync_edge
        self._command_sequence = self._taken = 0
        self._decoder = PollDecoder()
        self._polls: list[DrumState] = []
        self._ring: dict[int, RingSample] = {}
        self._decode(self._board.read(*POLL_BLOCK), 0)

    @property
    def time_us(self) -> int:
        """World time."""
        return self._drum.time_ms * 1000

    @property
    def truth(self) -> GroundTruth:
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
        entries = find_register("command"), find_register("command_sequence")
        words = [*pack_value(entries[0], command), *pack_value(entries[1], self._command_sequence)]
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
        """Poll every :data:`POLL_MS` from now on, for :meth:`polls`, with the tare of now."""
        self._decoder.tare_counts = round(self.get("tare_counts"))
        self._decoder.scale_ug_per_count = round(self.get("scale_ug_per_count"))
        self._drum.poll_every(POLL_MS, self._drum.time_ms + POLL_MS)

    def unwatch(self) -> None:
        """Poll no more."""
        self._drum.poll_every(0, 0)

    def polls(self) -> list[DrumState]:
        """Polls since the last call, oldest first; ``at_s`` is world time."""
        polls, self._polls = self._polls, []
        return polls

    def close(self) -> None:
        """Free the boards."""
        self._board.close()
        self.taxels.board.close()

    def _note(self) -> None:
        """Keep what came of a run: the board's newest conversions, and polls."""
        cycles, counts = self._drum.conversions()
        samples = zip(counts.tolist(), self._drum.board_us(cycles).tolist(), strict=True)
        first, self._taken = self._taken + 1, self._taken + len(counts)
        self._ring |= zip(range(first, self._taken + 1), samples, strict=True)
        words, at_ms = self._drum.polls()
        self._polls += map(self._decode, words.tolist(), at_ms.tolist())
        for number in list(self._ring)[:-RING_DEPTH]:
            del self._ring[number]

    def _decode(self, words: list[int], at_ms: int) -> DrumState:
        raw = self._decoder.unpack(words)
        ring = {n: self._ring[n] for n in self._decoder.missing(raw) if n in self._ring}
        return self._decoder.decode(raw, at_ms * 1e-3, ring)


@cache
def _layout_of(name: str) -> BlockLayout:
    entry = find_register(name)
    return BlockLayout(entry.address, entry.words * entry.count, [entry])
