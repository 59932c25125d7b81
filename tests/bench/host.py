"""A small host for tests: a Modbus master for the simulated drum, and a taxel decoder."""

from __future__ import annotations

import struct
from collections.abc import Callable

from rigctl.bench.simulated_rig import SimulatedRig
from rigctl.boards.drum_codes import Command, CommandResult
from rigctl.boards.drum_registers import (
    BY_NAME,
    POLL_BLOCK,
    REGISTERS,
    UNIT,
    BlockLayout,
    pack_value,
)
from rigctl.boards.drum_states import Fault, State
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.boards.taxel_frames import SelfTest, TaxelIdentity, TaxelStatus
from rigctl.values import Block

ANSWER_US = 60_000
POLL_US = 20_000
BOOT_US = 100_000
POLL_LAYOUT = BlockLayout(*POLL_BLOCK)


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC_OF_BYTE = [_crc_of(byte) for byte in range(256)]


def crc(data: bytes) -> int:
    """Return the CRC-16 of Modbus over serial line, 6.2.2; 0 for a frame with its CRC."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _CRC_OF_BYTE[(value ^ byte) & 0xFF]
    return value


def framed(body: bytes) -> bytes:
    """Append the CRC to a request."""
    return body + struct.pack("<H", crc(body))


class Refused(Exception):
    """The drum replied with this exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class Host:
    """A host on both cables of a simulated rig; every call takes simulated time."""

    def __init__(self, simulation: SimulatedRig) -> None:
        self.simulation = simulation
        self.drum_bytes = b""
        self.arrivals: list[float] = []
        self.blocks: list[Block] = []
        self.statuses: list[TaxelStatus] = []
        self.identities: list[TaxelIdentity] = []
        self.self_tests: list[SelfTest] = []
        self.lost: list[str] = []
        self.taxel_bytes: list[bytes] = []
        self.rejected = 0
        self._decoder = FrameDecoder(18)
        self._beat = self._sequence = 0
        simulation.drum.open(self._take_drum, self.lost.append)
        simulation.taxels.open(self._take_taxels, self.lost.append)

    def _take_drum(self, data: bytes, at_s: float) -> None:
        self.drum_bytes += data
        self.arrivals.append(at_s)

    def _take_taxels(self, data: bytes, at_s: float) -> None:
        self.taxel_bytes.append(data)
        decoded = self._decoder.feed(data, at_s)
        self.blocks += decoded.blocks
        self.statuses += decoded.statuses
        self.identities += decoded.identities
        self.self_tests += decoded.self_tests
        self.rejected += decoded.rejected_frames

    def wait(self, microseconds: int) -> None:
        """Let simulated time pass without polling."""
        until = self.simulation.time_us + microseconds
        while self.simulation.time_us < until:
            step = min(self.simulation.slice_us, until - self.simulation.time_us)
            self.simulation.advance(self.simulation.time_us + step)

    def ask(self, request: bytes) -> bytes:
        """Send a framed request and return the reply, empty after a timeout."""
        self.drum_bytes = b""
        self.simulation.drum.write(request)
        until = self.simulation.time_us + ANSWER_US
        while self.simulation.time_us < until:
            self.simulation.advance(self.simulation.time_us + self.simulation.slice_us)
            if len(self.drum_bytes) > 3 and crc(self.drum_bytes) == 0:
                break
        return self.drum_bytes

    def _answer(self, body: bytes) -> bytes:
        answer = self.ask(framed(body))
        assert answer, "the drum did not reply"
        if answer[1] & 0x80:
            raise Refused(answer[2])
        return answer[2:-2]

    def read(self, address: int, count: int) -> tuple[int, ...]:
        """Read words with function 3. Raises Refused."""
        data = self._answer(struct.pack(">BBHH", UNIT, 3, address, count))
        return struct.unpack(f">{count}H", data[1:])

    def write(self, address: int, *words: int) -> None:
        """Write words with function 16. Raises Refused."""
        head = struct.pack(">BBHHB", UNIT, 16, address, len(words), 2 * len(words))
        self._answer(head + struct.pack(f">{len(words)}H", *words))

    def get(self, name: str) -> int:
        """Read a register's integer."""
        entry = BY_NAME[name]
        layout = BlockLayout(entry.address, entry.words * entry.count, REGISTERS)
        return layout.unpack(self.read(layout.address, layout.count))[name][0]

    def put(self, name: str, raw: int) -> None:
        """Write a register's integer. Raises Refused."""
        self.write(BY_NAME[name].address, *pack_value(BY_NAME[name], raw))

    def poll(self) -> dict[str, int]:
        """Send a heartbeat and read the poll block with function 23."""
        self._beat = (self._beat + 1) & 0xFFFF
        body = struct.pack(">BBHHHHBH", UNIT, 23, *POLL_BLOCK, 64, 1, 2, self._beat)
        words = struct.unpack(f">{POLL_BLOCK[1]}H", self._answer(body)[1:])
        raw = POLL_LAYOUT.unpack(words)
        return {name: numbers[0] for name, numbers in raw.items()}

    def command(self, command: Command) -> None:
        """Send a command with a heartbeat. Raises Refused."""
        self._beat = (self._beat + 1) & 0xFFFF
        self._sequence = (self._sequence + 1) & 0xFFFF
        self.write(64, self._beat, command, self._sequence)

    def attend(self, microseconds: int) -> dict[str, int]:
        """Poll at 50 Hz for a time and return the last poll."""
        until = self.simulation.time_us + microseconds
        return self.until(lambda poll: self.simulation.time_us >= until, microseconds + POLL_US)

    def until(
        self, condition: Callable[[dict[str, int]], bool], limit_us: int = 20_000_000
    ) -> dict[str, int]:
        """Poll at 50 Hz until a poll meets the condition, and return it."""
        end = self.simulation.time_us + limit_us
        while True:
            begun = self.simulation.time_us
            poll = self.poll()
            if condition(poll):
                return poll
            assert self.simulation.time_us < end, f"not in time: {poll}"
            self.wait(max(1, begun + POLL_US - self.simulation.time_us))

    def state(self, state: State, limit_us: int = 20_000_000) -> dict[str, int]:
        """Poll until the drum is in a state, and return the poll."""
        return self.until(lambda poll: poll["state"] == state, limit_us)

    def fault(self) -> Fault:
        """Read the latched fault."""
        return Fault(self.get("fault"))

    def idle(self) -> None:
        """Wait after power-up until the drum has tested itself."""
        self.wait(BOOT_US)
        self.state(State.IDLE)

    def armed(self) -> None:
        """Arm and tare after power-up."""
        self.idle()
        self.command(Command.COMMISSION)
        self.until(lambda poll: poll["command_result"] == CommandResult.DONE)
        self.command(Command.ARM)
        self.state(State.ARMED)
        self.command(Command.TARE)
        self.until(lambda poll: poll["command_result"] == 1)

    def holding(self, force_g: float = 500.0) -> None:
        """Arm, tare and approach after power-up."""
        self.armed()
        self.put("force_set", round(10 * force_g))
        self.command(Command.APPROACH)
        self.state(State.HOLD)
