"""Checks of what the drum's image makes of bad load-cell amplifiers, and their broken images."""

from __future__ import annotations

import numpy as np

from rigctl.bench.chips.simavr import ResetBy
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.checks import SET_FORCE_G, Check
from tests.firmware.drum.support.chip import G_PER_COUNT, MS, DrumChip

SPIKE_G = 1000.0
SLOW_PERIOD_Q16 = 100 * MS << 16
E_MINUS_OPEN_COUNTS = 4000.0
"""Noise of a module whose E- is not connected to ground, as the simulated bench has it."""
REFUSED = 4


class BadCell(DrumChip):
    """A drum whose readings have an error: a constant one, and noise."""

    error_g = 0.0
    noise_counts = 0.0

    def _advance_bench(self, duty: float) -> None:
        super()._advance_bench(duty)
        noise = self.noise_counts * self._noise.standard_normal()
        self.x.loadcell_counts += round(self.error_g / G_PER_COUNT + noise)

    def spike(self, error_g: float) -> None:
        """Make one conversion wrong."""
        conversions = self.x.loadcell_conversions
        self.error_g = error_g
        while self.x.loadcell_conversions == conversions:
            self.run(1)
        self.error_g = 0.0

    def has(self, fault: Fault) -> bool:
        """Return whether the cause of a fault is present."""
        return bool(self.get("fault_bits") >> fault & 1)


def a_single_bad_sample_ends_nothing(image: str) -> None:
    """Spikes of 1,000 g either way are counted, and the drum goes on holding its force."""
    with BadCell(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        drum.poll_for(1000)
        for error_g in (SPIKE_G, -SPIKE_G, SPIKE_G):
            drum.spike(error_g)
            drum.poll_for(200)
        assert drum.state is State.HOLD
        assert drum.get("loadcell_spikes") == 3


def a_single_bad_sample_moves_no_force(image: str) -> None:
    """The true force stays within 2 % while a sample is wrong by 300 g, below the limit."""
    with BadCell(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        drum.poll_for(1000)
        begun = len(drum.forces)
        for _ in range(5):
            drum.spike(300.0)
            drum.poll_for(200)
        assert drum.state is State.HOLD
        assert np.abs(np.array(drum.forces[begun:]) / SET_FORCE_G - 1).max() <= 0.02


def another_rate_is_named_and_not_armed(image: str) -> None:
    """Ten samples a second are told from silence; told of them, the drum arms."""
    with BadCell(image) as drum:
        drum.x.loadcell_period_q16 = SLOW_PERIOD_Q16
        drum.run(1500)
        assert drum.state is State.FAULT_OFF  # the rate changed under way: the old one is missed
        drum.chip.reset(ResetBy.POWER)
        drum.run(2000)
        assert drum.state is State.IDLE
        assert drum.has(Fault.LOADCELL_RATE) and not drum.has(Fault.LOADCELL_SILENT)
        assert abs(drum.get("loadcell_rate") - 1000) <= 10
        assert drum.command(Command.ARM) == REFUSED
        assert drum.set("loadcell_slow", 1) == 0
        assert not drum.has(Fault.LOADCELL_RATE)
        drum.arm()


def readings_that_no_cell_gives_are_not_armed(image: str) -> None:
    """The drum arms again when the readings are those of a cell."""
    with BadCell(image) as drum:
        drum.noise_counts = E_MINUS_OPEN_COUNTS
        drum.run(2000)
        assert drum.state is State.IDLE
        assert drum.has(Fault.LOADCELL_NOISE)
        assert drum.command(Command.ARM) == REFUSED
        drum.noise_counts = 0.0
        drum.run(2000)
        assert not drum.has(Fault.LOADCELL_NOISE)
        drum.arm()


CELL_CONTROLS: tuple[tuple[str, str, Check], ...] = (
    (
        "one-sample",
        "one sample above the settings' limit decides",
        a_single_bad_sample_ends_nothing,
    ),
    ("spikes-felt", "the loop acts on every sample", a_single_bad_sample_moves_no_force),
    ("any-rate", "no rate is wrong", another_rate_is_named_and_not_armed),
    ("untested-cell", "no reading is too noisy", readings_that_no_cell_gives_are_not_armed),
)
"""Broken image, what is broken in it, and the check that must fail on it."""
