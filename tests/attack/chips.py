"""The same attacks on the drum's image on its simulated chip, over Modbus."""

from __future__ import annotations

import struct

from rigctl.bench.chips.simavr import ResetBy
from rigctl.bench.circuit import Circuit
from rigctl.bench.mechanics import Mechanics
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from tests.attack.benches import NEAR, PLATE, SEED
from tests.firmware.drum.support.plant_drum import PlantDrum

HEARTBEAT_PERIOD_MS = 80
NO_ANSWER = -1
HEARTBEAT, STATE = BY_NAME["heartbeat"].address, BY_NAME["state"].address


class _Drum(PlantDrum):
    """A drum that logs the duty of each millisecond."""

    def __init__(self, image: str, parameters: WorldParameters) -> None:
        self.duties: list[float] = []
        super().__init__(parameters, PLATE, SEED, image)

    def _advance_bench(self, duty: float) -> None:
        self.duties.append(duty)
        super()._advance_bench(duty)


class ChipBench:
    """A chip at power-up with simulated mechanics and a Modbus master."""

    def __init__(
        self, image: str = "firmware/drum.elf", parameters: WorldParameters = NEAR
    ) -> None:
        self.parameters = parameters
        self._drum = _Drum(image, parameters)
        self._heartbeat_on, self._heartbeats, self._heartbeat_at_ms = True, 0, 0

    @property
    def plant(self) -> Mechanics:
        """The mechanics."""
        return self._drum.plant

    @property
    def state(self) -> State:
        """State that the board reports; BOOT if it does not reply."""
        return State((self.read(STATE, 1) or [State.BOOT])[0])

    @property
    def last_heartbeat_ms(self) -> int:
        """Simulated time at which the last heartbeat had arrived."""
        return self._heartbeat_at_ms

    def set_heartbeat(self, on: bool) -> None:
        """Switch the heartbeat on or off."""
        self._heartbeat_on = on
        if on:
            self._send_heartbeat()

    def run(self, milliseconds: int) -> None:
        """Advance, at most to the next due heartbeat, and send it."""
        self._drum.run(min(milliseconds, HEARTBEAT_PERIOD_MS))
        self._send_due_heartbeat()

    def drive(self) -> tuple[float, float]:
        """Return the lowest and highest duty since the last call."""
        duties, self._drum.duties = self._drum.duties, []
        return min(duties, default=0.0), max(duties, default=0.0)

    def write(self, address: int, words: tuple[int, ...]) -> int:
        """Write registers; return 0 if the board accepts them.

        A heartbeat that is due goes first, or a long series of writes would end in a fault.
        """
        self._send_due_heartbeat()
        return self._write(address, words)

    def _write(self, address: int, words: tuple[int, ...]) -> int:
        count = len(words)
        head = struct.pack(">BHHB", 16, address, count, 2 * count)
        answer = self._drum.exchange(head + struct.pack(f">{count}H", *words))
        if not answer:
            return NO_ANSWER
        return answer[2] if answer[1] & 0x80 else 0

    def read(self, address: int, count: int) -> list[int]:
        """Read registers; return an empty list without a reply."""
        answer = self._drum.exchange(struct.pack(">BHH", 3, address, count))
        return list(struct.unpack(f">{count}H", answer[3:])) if answer else []

    def estop(self, pressed: bool) -> None:
        """Press or release the emergency stop."""
        self._drum.bench.disturbances.estop_pressed = pressed
        self._drum.connect()

    def connect(self, circuit: Circuit) -> None:
        """Connect the bench in this way."""
        self._drum.bench.disturbances.circuit = circuit
        self._drum.connect()

    def push(self, force_g: float) -> None:
        """Press on the load cell by hand."""
        self._drum.bench.disturbances.push_g = force_g
        self._drum.connect()

    def reset(self) -> None:
        """Press the board's reset button."""
        self._drum.chip.reset(ResetBy.PIN)

    def close(self) -> None:
        """Free the chip."""
        self._drum.chip.close()

    def _send_due_heartbeat(self) -> None:
        if self._heartbeat_on and self.plant.time_ms - self._heartbeat_at_ms >= HEARTBEAT_PERIOD_MS:
            self._send_heartbeat()

    def _send_heartbeat(self) -> None:
        self._heartbeats = self._heartbeats % 0xFFFF + 1
        if self._write(HEARTBEAT, (self._heartbeats,)) == 0:
            self._heartbeat_at_ms = self.plant.time_ms
