"""The same attacks on the drum's image on its chip, over its wire."""

from __future__ import annotations

import struct

from rigctl.simulation.bench.mechanics import Mechanics
from rigctl.simulation.chips.simavr import Input, ResetBy
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State
from tests.attack.benches import NEAR, PLATE, SEED
from tests.firmware.drum.support.plant_drum import PlantDrum

BEAT_EVERY_MS = 80
NO_ANSWER = -1
HEARTBEAT, STATE = BY_NAME["heartbeat"].address, BY_NAME["state"].address


class _Drum(PlantDrum):
    """Keeps the duty of each millisecond until somebody asks."""

    def __init__(self, image: str) -> None:
        self.duties: list[float] = []
        super().__init__(NEAR, PLATE, SEED, image)

    def _press(self, duty: float) -> None:
        self.duties.append(duty)
        super()._press(duty)


class ChipBench:
    """A chip at power-up under the mechanics of the world, spoken to as Modbus master."""

    def __init__(self, image: str = "firmware/drum.elf") -> None:
        self._drum = _Drum(image)
        self._beating, self._beats, self._beat_ms = True, 0, 0

    @property
    def plant(self) -> Mechanics:
        """The mechanics."""
        return self._drum.plant

    @property
    def state(self) -> State:
        """State that the board says; BOOT where it does not answer."""
        return State((self.read(STATE, 1) or [State.BOOT])[0])

    @property
    def beat_ms(self) -> int:
        """World time at which a beat had arrived."""
        return self._beat_ms

    def beats(self, on: bool) -> None:
        """Let the heartbeat go on, or fall silent."""
        self._beating = on
        if on:
            self._beat()

    def run(self, milliseconds: int) -> None:
        """Let time pass, until the next beat is due at most, and give it."""
        self._drum.run(min(milliseconds, BEAT_EVERY_MS))
        if self._beating and self.plant.time_ms - self._beat_ms >= BEAT_EVERY_MS:
            self._beat()

    def drive(self) -> tuple[float, float]:
        """Lowest and highest duty since the last call."""
        duties, self._drum.duties = self._drum.duties, []
        return min(duties, default=0.0), max(duties, default=0.0)

    def write(self, address: int, words: tuple[int, ...]) -> int:
        """Write registers; 0 where the board took them."""
        count = len(words)
        head = struct.pack(">BHHB", 16, address, count, 2 * count)
        answer = self._drum.exchange(head + struct.pack(f">{count}H", *words))
        if not answer:
            return NO_ANSWER
        return answer[2] if answer[1] & 0x80 else 0

    def read(self, address: int, count: int) -> list[int]:
        """Read registers; nothing where the board does not answer."""
        answer = self._drum.exchange(struct.pack(">BHH", 3, address, count))
        return list(struct.unpack(f">{count}H", answer[3:])) if answer else []

    def estop(self, pressed: bool) -> None:
        """Press or release the emergency stop."""
        self._drum.pin(Input.ESTOP, int(pressed))

    def reset(self) -> None:
        """Press the board's reset button."""
        self._drum.chip.reset(ResetBy.PIN)

    def close(self) -> None:
        """Free the chip."""
        self._drum.chip.close()

    def _beat(self) -> None:
        self._beats = self._beats % 0xFFFF + 1
        if self.write(HEARTBEAT, (self._beats,)) == 0:
            self._beat_ms = self.plant.time_ms
