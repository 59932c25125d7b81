"""The drum of ``variants/other_drum.h`` on a matching bench."""

from __future__ import annotations

from dataclasses import replace

from rigctl.bench.chips.simavr import Input
from rigctl.bench.load_cell import LoadCellAmplifier
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command
from tests.firmware.drum.support.plant_drum import PlantDrum

IMAGE = "firmware/drum-other.elf"
BENCH = WorldParameters(
    circumference_mm=360,
    plate_length_mm=330,
    steps_per_turn=6400,
    actuator_speed_mm_s=6,
    actuator_lag_ms=45,
    actuator_travel_mm=40,
)
STEP_MM = 0.05625
OTHER_WAY_ROUND = {Input.END_UP: Input.END_DOWN, Input.END_DOWN: Input.END_UP}
"""Inputs of the default variant, to which this one's end switches are connected."""
SELFTEST_MS = 1800
"""The amplifier settles for four conversions, the firmware for four more, and it tests eight."""
GAINS = 400, 150
"""Initial gains of the force loop, 0.01/s: low enough to hold a force before tuning."""

SETTLE_TIME_MS = 1000
"""Time within the band until the force is settled: ten samples, as 300 ms have only three."""


class OtherDrum(PlantDrum):
    """A booted drum in IDLE; ten conversions a second, each the mean of a tenth of a second."""

    def __init__(self) -> None:
        super().__init__(BENCH, image=IMAGE)
        self.run(SELFTEST_MS)

    def _wire_up(self) -> None:
        slow = replace(self.parameters, loadcell_rate_hz=10.0, loadcell_average_ms=100.0)
        self.bench.loadcell = LoadCellAmplifier(slow, 1, self.plant, self.bench.disturbances)
        self.x.enable_high = 1
        self.x.port_a_first = 3
        super()._wire_up()

    def _set_level(self, signal: Input, level: bool) -> None:
        super()._set_level(OTHER_WAY_ROUND.get(signal, signal), level)

    def tune(self) -> None:
        """Home and tare, and set the gains that the board proposes."""
        self.prepare()
        self.set("settle_time_ms", SETTLE_TIME_MS)
        self._set_gains(*GAINS)
        self.hold(500)
        assert self.command(Command.TUNE, 30_000) == 0
        self._set_gains(self.get("proposed_gain_p"), self.get("proposed_gain_i"))
        assert self.command(Command.RETRACT, 5000) == 0

    def _set_gains(self, gain_p: int, gain_i: int) -> None:
        self.set("gain_p", gain_p)
        self.set("gain_i", gain_i)
