"""What the virtual drum sees go wrong now: emergency stop, load cell, force, heartbeat."""

from __future__ import annotations

from rigctl.wire.drum_map import Signal
from rigctl.wire.drum_states import Fault
from rigctl.world.drum_loadcell import LoadcellWatch
from rigctl.world.drum_registers import RegisterBank
from rigctl.world.simulation import Disturbances


class Health:
    """The causes of faults, as far as they are present. Times are world microseconds."""

    def __init__(
        self, bench: Disturbances, bank: RegisterBank, cell: LoadcellWatch, at_us: int
    ) -> None:
        self._bench = bench
        self._bank = bank
        self._cell = cell
        self.silent = True
        self.beat_us = at_us

    def fitted(self, signal: Signal) -> bool:
        """The optional signal is there, as the settings say."""
        return bool(self._bank.settings["optional_signals"] >> signal & 1)

    def shown(self, signal: Signal, level: bool) -> bool:
        """What the board takes a wire for whose far end has this level."""
        inverted = bool(self._bank.settings["signal_polarity"] >> signal & 1)
        return self._bench.wire(signal, level) != inverted

    @property
    def estop_wire_open(self) -> bool:
        """The emergency stop's wire shows it pressed, fitted or not."""
        return self.shown(Signal.ESTOP, self._bench.estop_pressed)

    @property
    def estop_open(self) -> bool:
        """The emergency stop is pressed and fitted."""
        return self.fitted(Signal.ESTOP) and self.estop_wire_open

    @property
    def loadcell(self) -> list[Fault]:
        """What the newest reading of the load cell shows."""
        if self.silent:
            return [Fault.LOADCELL_SILENT]
        # Either way: with a scale of the wrong sign, pressing reads as pulling.
        too_strong = abs(self._cell.force_g) > 0.1 * self._bank.settings["over_force"]
        return self._cell.faults() or ([Fault.OVER_FORCE] if too_strong else [])

    def causes(self, latched: Fault, now_us: int) -> list[Fault]:
        """Everything that is wrong now; a lost heartbeat counts while it is what is latched."""
        found = self.loadcell
        if self.estop_open:
            found = [Fault.ESTOP, *found]
        limit_us = 1000 * self._bank.settings["heartbeat_limit_ms"]
        if latched is Fault.HEARTBEAT and now_us - self.beat_us > limit_us:
            found = [*found, Fault.HEARTBEAT]
        return found
