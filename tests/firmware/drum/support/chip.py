"""The drum controller's image on its chip, with a simple bench and a Modbus master."""

from __future__ import annotations

import struct
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.chips.simavr import Chip, Input, Kind, Output, load_library
from rigctl.bench.circuit import AS_DRAWN
from rigctl.bench.electrics import actuator_pins, constants
from rigctl.boards.drum_codes import Command, CommandResult, Status
from rigctl.boards.drum_registers import BY_NAME, Register
from rigctl.boards.drum_states import State
from tests.firmware.building import built

MS = 16_000
WIRED = constants(AS_DRAWN)
"""The electrical layer of a bench that is wired as drawn."""
ENTRY_CYCLES = 5
"""Interrupt entry of the 2560, which the simulator does not count."""
CONTACT_MM = 20.0
STIFFNESS_G_MM = 600.0
ACTUATOR_MM_S = 10.0
OFFSET_COUNTS = 80_000
G_PER_COUNT = 2400e-6


def _crc_of_byte(crc: int) -> int:
    for _ in range(8):
        crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


_CRC_OF_BYTE = [_crc_of_byte(byte) for byte in range(256)]


def crc16(data: bytes) -> bytes:
    """Return the CRC of Modbus, low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _CRC_OF_BYTE[(crc ^ byte) & 0xFF]
    return struct.pack("<H", crc)


class DrumChip:
    """An image on a chip that runs in steps of a millisecond; leaving the context frees it.

    ``potentiometer``: share of the supply at its pin, None where it is whole. ``cell_is_dead``: its
    excitation is broken. ``finger_g``: a finger presses on the load cell.
    """

    def __init__(self, image: str = "firmware/drum.elf", bootloader: Path | None = None) -> None:
        library = load_library(built("sim/libchips.so"))
        self.chip = Chip(library, built(image), Kind.DRUM, bootloader)
        self.x = self.chip.io
        self.x.report_steps = 1
        self.x.host_byte_q16 = round(16e6 * 10 / 115200 * 65536)
        self.x.analog_rows = 1
        self._wire_up()
        self.beating = True
        self.potentiometer: float | None = None
        self.cell_is_dead = False
        self.finger_g = 0.0
        self.rod_mm, self.force_g = 5.0, 0.0
        self.actuator_mm_s = ACTUATOR_MM_S
        self.forces: list[float] = []
        self._velocity = 0.0
        self._felt = [0.0] * 10
        self._noise = np.random.default_rng(1)
        self._edges: list[NDArray[np.int64]] = []
        self._answer = b""
        self.last_byte_cycle = 0
        self.first_reply_cycle = 0
        self._sequence = self._beat = 0
        self.run(250)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.chip.close()

    def _wire_up(self) -> None:
        self.x.loadcell_period_q16 = 198_413 << 16
        self.x.loadcell_counts = OFFSET_COUNTS

    # --- time and bench ---------------------------------------------------------------------

    def run(self, milliseconds: int) -> None:
        """Run without sending a byte."""
        for _ in range(milliseconds):
            self._one_ms()

    def _one_ms(self) -> None:
        self.chip.run((self.x.cycle // MS + 1) * MS)
        count = self.x.edge_count
        if count:
            rows = (self.chip.edge_cycle, self.chip.edge_signal, self.chip.edge_level)
            self._edges.append(np.stack([r[:count].astype(np.int64) for r in rows], axis=1))
        if self.x.tx_count and not self._answer:
            self.first_reply_cycle = int(self.chip.tx_cycle[0])
        self._answer += self.chip.tx[: self.x.tx_count].tobytes()
        self._advance_bench(self.x.drive)

    def _advance_bench(self, duty: float) -> None:
        target = 0.0
        if abs(duty) > 0.08:
            target = np.sign(duty) * (abs(duty) - 0.08) / 0.92 * self.actuator_mm_s
        self._velocity += (target - self._velocity) / 30.5
        self.rod_mm = min(max(self.rod_mm + self._velocity * 1e-3, 0.0), 50.0)
        depth = self.rod_mm - CONTACT_MM
        self.force_g = max(0.0, STIFFNESS_G_MM * depth)
        self.forces.append(self.force_g)
        felt_g = 0.0 if self.cell_is_dead else self.force_g + self.finger_g
        self._felt = [*self._felt[1:], felt_g]
        felt = sum(self._felt) / 10 + 0.3 * self._noise.standard_normal()
        self.x.loadcell_counts = OFFSET_COUNTS + round(felt / G_PER_COUNT)
        self.chip.analog[0, 0] = actuator_pins(WIRED, self.rod_mm, 50.0)[0]
        if self.potentiometer is not None:
            self.chip.analog[0, 0] = self.potentiometer

    def pin(self, signal: Input, level: int, after_cycles: int = 0) -> int:
        """Change an input pin after some cycles; return the cycle of the change."""
        at = int(self.x.cycle) + after_cycles
        self.chip.set_input(signal, at, level)
        return at

    # --- edges ------------------------------------------------------------------------------

    def clear_edges(self) -> None:
        """Discard the output edges so far."""
        self._edges = []

    def edges(self, signal: Output) -> NDArray[np.int64]:
        """Return the edges of an output since the last clear, int64 (n, 2): cycle and level."""
        rows = np.concatenate([np.empty((0, 3), np.int64), *self._edges])
        chosen: NDArray[np.int64] = rows[rows[:, 1] == signal][:, (0, 2)]
        return chosen

    def steps(self) -> NDArray[np.int64]:
        """Return the cycles of the step pulses since the last clear."""
        cycles: NDArray[np.int64] = self.edges(Output.STEP)[:, 0]
        return cycles

    # --- Modbus -----------------------------------------------------------------------------

    def exchange(self, pdu: bytes, limit_ms: int = 40) -> bytes:
        """Send a request to unit 1; return the reply without CRC, empty without a reply."""
        frame = b"\x01" + pdu
        return self.send_raw(frame + crc16(frame), limit_ms)

    def send_raw(self, data: bytes, limit_ms: int = 40) -> bytes:
        """Send bytes unchanged; return the reply without CRC, empty without a reply."""
        self._answer = b""
        begun = int(self.x.cycle)
        self.chip.send(data)
        self.last_byte_cycle = begun + round(len(data) * self.x.host_byte_q16 / 65536)
        for _ in range(limit_ms):
            self._one_ms()
            if self._is_complete():
                answer, check = self._answer[:-2], self._answer[-2:]
                assert crc16(answer) == check
                return answer
        assert not self._answer, f"half an answer: {self._answer.hex()}"
        return b""

    def _is_complete(self) -> bool:
        got = self._answer
        if len(got) < 5:
            return False
        if got[1] & 0x80:
            return True
        return len(got) == (5 + got[2] if got[1] in (3, 23) else 8)

    def get(self, name: str) -> int:
        """Read one register."""
        register = BY_NAME[name]
        answer = self.exchange(struct.pack(">BHH", 3, register.address, register.words))
        return _value(register, answer[3:])

    def write(self, address: int, *words: int) -> int:
        """Write registers with function 16; return the exception code, 0 if accepted."""
        head = struct.pack(">BHHB", 16, address, len(words), 2 * len(words))
        answer = self.exchange(head + struct.pack(f">{len(words)}H", *words))
        return answer[2] if answer[1] & 0x80 else 0

    def set(self, name: str, value: int) -> int:
        """Write one setting as a raw integer; return the exception code, 0 if accepted."""
        register = BY_NAME[name]
        if register.words == 1:
            return self.write(register.address, value & 0xFFFF)
        return self.write(register.address, value >> 16 & 0xFFFF, value & 0xFFFF)

    def beat(self) -> bytes:
        """Send a poll with the next heartbeat; return the reply."""
        self._beat = (self._beat + 1) & 0xFFFF
        return self.exchange(struct.pack(">BHHHHBH", 23, 16, 40, 64, 1, 2, self._beat))

    def poll_for(self, milliseconds: int) -> None:
        """Poll 50 times a second, with the heartbeat."""
        end = self.x.cycle // MS + milliseconds
        while self.x.cycle // MS < end:
            start = self.x.cycle // MS
            if self.beating:
                self.beat()
            self.run(int(max(0, start + 20 - self.x.cycle // MS)))

    def command(self, command: Command, limit_ms: int = 0) -> int:
        """Send a command and, with a limit, poll until it ends; return the exception code or 0."""
        self._sequence += 1
        refused = self.write(BY_NAME["command"].address, int(command), self._sequence)
        end = self.x.cycle // MS + limit_ms
        while limit_ms and self.get("command_result") == CommandResult.RUNNING:
            assert self.x.cycle // MS < end, f"{command.name} takes too long"
            self.poll_for(20)
        return refused

    @property
    def state(self) -> State:
        """The board's state."""
        return State(self.get("state"))

    def arm(self) -> None:
        """Commission the board for its settings, arm, and tare the load cell."""
        if not self.get("status_bits") >> Status.COMMISSIONED & 1:
            assert self.command(Command.COMMISSION, 500) == 0
        assert self.command(Command.ARM, 5000) == 0
        assert self.command(Command.TARE, 8000) == 0
        assert self.state is State.ARMED

    def hold(self, force_g: int) -> None:
        """Approach to HOLD at a force."""
        self.set("force_set", force_g * 10)
        assert self.command(Command.APPROACH, 15_000) == 0
        assert self.state is State.HOLD


def _value(register: Register, data: bytes) -> int:
    signed = register.kind.startswith("i")
    return int.from_bytes(data[: 2 * register.words], "big", signed=signed)
