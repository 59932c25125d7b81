"""The virtual rig without cables: callers write registers and read samples directly.

Bench and firmware are those of the virtual rig. Frames, Modbus and a polling host are left out,
which makes it many times as fast.
"""

from __future__ import annotations

from concurrent.futures import Executor
from functools import cache

from rigctl.bench.bench import LOG_EVERY_MS, Bench
from rigctl.bench.boards.drum_cosimulation import NOMINAL_HZ, DrumCosimulation
from rigctl.bench.boards.drum_firmware import ACCEPTED
from rigctl.bench.boards.taxels import VirtualTaxels
from rigctl.bench.ground_truth import GroundTruth
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command, CommandResult
from rigctl.boards.drum_poll import PollDecoder, RingSample
from rigctl.boards.drum_registers import (
    POLL_BLOCK,
    RING_DEPTH,
    BlockLayout,
    find_register,
    pack_value,
    plan_writes,
)
from rigctl.boards.drum_states import Fault, State
from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray
from rigctl.errors import BoardFault
from rigctl.values import DrumState

POLL_MS = 100
CYCLES_PER_US = NOMINAL_HZ // 1_000_000


class DirectRig:
    """One bench with direct access to the drum's registers, reproducible for a seed.

    The drum's heartbeat is always on. ``executor``, if given, computes noise in advance.

    Raises WrongUse for a parameter outside its plausible range, RigFault if a board's library
    cannot be used.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        seed: int,
        executor: Executor | None = None,
        sensor: TaxelArray = PAPER_ARRAY,
    ) -> None:
        self.parameters = parameters
        self._bench = Bench(parameters, seed, executor, sensor=sensor)
        self._drum = DrumCosimulation(self._bench)
        self._firmware = self._drum.firmware
        self._firmware.io.heartbeat_on = 1
        self.taxels = VirtualTaxels(self._bench)
        self._drum.on_index = self.taxels.set_index
        self._bench.on_sync = self.taxels.set_sync
        self._command_sequence = self._samples_taken = 0
        self._decoder = PollDecoder()
        self._polls: list[DrumState] = []
        self._ring: list[RingSample] = []
        self._decode(self._firmware.read(*POLL_BLOCK), 0)

    @property
    def time_us(self) -> int:
        return self._drum.time_ms * 1000

    @property
    def truth(self) -> GroundTruth:
        return self._bench.truth

    @property
    def state(self) -> State:
        return State(self._firmware.io.state)

    @property
    def fault(self) -> Fault:
        return Fault(self._firmware.io.fault)

    @property
    def result(self) -> CommandResult:
        return CommandResult(self._firmware.io.result)

    def to_simulated_us(self, board_us: int) -> float:
        """Convert a time of the drum board to simulated time."""
        return self._drum.us(board_us * CYCLES_PER_US + self._firmware.io.boot_cycle)

    def set_plate(self, name: str) -> None:
        """Mount a plate. Raises WrongUse for a name that is not in the catalogue."""
        self._bench.set_plate(name)

    def write_settings(self, **values: float) -> None:
        """Write settings in engineering units.

        Raises WrongUse for a value out of its bounds, BoardFault if the board rejects it.
        """
        for write in plan_writes(values):
            if self._firmware.write(write.address, write.words) != ACCEPTED:
                names = ", ".join(write.names)
                raise BoardFault(f"the simulated drum refused {names} in {self.state.name}")

    def read(self, name: str) -> float:
        """Read a register in engineering units."""
        layout = _layout_of(name)
        return layout.values(self._firmware.read(layout.address, layout.count))[name]

    def command(self, command: Command) -> bool:
        """Send a command; return False if the drum rejects it."""
        self._command_sequence = self._command_sequence % 65535 + 1
        entries = find_register("command"), find_register("command_sequence")
        words = [*pack_value(entries[0], command), *pack_value(entries[1], self._command_sequence)]
        return self._firmware.write(entries[0].address, words) == ACCEPTED

    def advance(self, until_us: int, stop_on_change: bool = True) -> None:
        """Simulate whole milliseconds up to a time, or until state, fault or result changes."""
        changes = self._firmware.io.change_count
        while self.time_us + 1000 <= until_us:
            until_ms = min(until_us // 1000, self._drum.time_ms + LOG_EVERY_MS)
            self._drum.run(until_ms, stop_on_change)
            self._collect()
            if stop_on_change and self._firmware.io.change_count != changes:
                return

    def start_polling(self) -> None:
        """Poll every :data:`POLL_MS` from now on, with the present tare and scale."""
        self._decoder.tare_counts = round(self.read("tare_counts"))
        self._decoder.scale_ug_per_count = round(self.read("scale_ug_per_count"))
        self._drum.poll_every(POLL_MS, self._drum.time_ms + POLL_MS)

    def stop_polling(self) -> None:
        self._drum.poll_every(0, 0)

    def take_polls(self) -> list[DrumState]:
        """Return the polls since the last call, oldest first; ``at_s`` is simulated time."""
        polls, self._polls = self._polls, []
        return polls

    def close(self) -> None:
        self._firmware.close()
        self.taxels.firmware.close()

    def _collect(self) -> None:
        """Collect the conversions and polls of the last run."""
        cycles, counts = self._drum.conversions()
        self._samples_taken += len(counts)
        self._ring += zip(counts.tolist(), self._drum.board_us(cycles).tolist(), strict=True)
        words, at_ms = self._drum.polls()
        self._polls += map(self._decode, words.tolist(), at_ms.tolist())
        del self._ring[:-RING_DEPTH]

    def _decode(self, words: list[int], at_ms: int) -> DrumState:
        raw = PollDecoder.layout.unpack(words)
        oldest = self._samples_taken - len(self._ring) + 1
        held = range(oldest, self._samples_taken + 1)
        ring = {n: self._ring[n - oldest] for n in self._decoder.missing(raw) if n in held}
        return self._decoder.decode(raw, at_ms * 1e-3, ring)


@cache
def _layout_of(name: str) -> BlockLayout:
    entry = find_register(name)
    return BlockLayout(entry.address, entry.words * entry.count, [entry])
