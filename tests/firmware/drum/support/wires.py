"""Checks of what an image does when a wire of the actuator, potentiometer or load cell is wrong.

Each passes on the flashed image and fails on one without the tested rule (:data:`WIRE_CONTROLS`).
"""

from __future__ import annotations

from rigctl.bench.chips.simavr import Input, ResetBy
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.checks import SET_FORCE_G, Check
from tests.firmware.drum.support.chip import CONTACT_MM, STIFFNESS_G_MM, DrumChip

SWAPPED = "firmware/drum-swapped.elf"
"""The image, whose actuator has its two wires the other way round."""
UNCOMMISSIONED_G = 300
FIRST_MM = 0.25
"""Way of a nudge the wrong way: 0.1 mm, and what a rod at a fifth of its speed still travels."""
BEYOND_MM, STILL_MM, KEPT_MM = 1.0, 0.4, 0.3
"""Ways that a drum may go without a force: below the last contact, and where it stands still; and
how much the kept place of the last contact may be another."""
LATE_MM = 6 * (0.0125 + 0.006 + 0.001 + 0.0305) + 6 * (0.0125 + 0.006)
"""Way at 6 mm/s until a sample, a tick and the lag are over; and what the bound grants the cell."""


def a_swapped_actuator_presses_less_than_300_g(image: str) -> None:
    """The drum is armed a hair above the sensor, three times; each time all is off at once.

    The board is commissioned after the first, so that the later ones lift at full duty.
    """
    with DrumChip(image) as drum:
        drum.rod_mm = CONTACT_MM - 0.05
        drum.run(60)
        for _ in range(3):
            assert drum.command(Command.ARM) == 0
            drum.poll_for(1500)
            assert drum.get("fault") == Fault.ACTUATOR_REVERSED
            assert drum.x.drive == 0
            assert drum.rod_mm - CONTACT_MM < FIRST_MM
            assert drum.command(Command.CLEAR) == 0
            drum.rod_mm = CONTACT_MM - 0.05
            drum.run(60)
            assert drum.command(Command.COMMISSION, 500) == 0
        assert max(drum.forces) < UNCOMMISSIONED_G


def a_broken_potentiometer_is_never_the_top(image: str) -> None:
    """A lift goes on until the sensor is free, and ends in a fault with everything off."""
    for share in (0.0, 1.0):
        with DrumChip(image) as drum:
            drum.arm()
            drum.hold(SET_FORCE_G)
            drum.potentiometer = share
            drum.command(Command.RETRACT)
            drum.poll_for(100)
            assert drum.state is State.FAULT_LIFT
            assert drum.get("fault") == Fault.POSITION_WIRE
            assert drum.command(Command.MOVE) != 0
            drum.poll_for(9000)
            assert drum.state is State.FAULT_OFF
            assert drum.force_g == 0


def an_open_upper_switch_is_not_the_top_in_contact(image: str) -> None:
    """Its wire breaks in HOLD; the lift goes on until the sensor is free."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        drum.pin(Input.END_UP, 1)
        drum.poll_for(2000)
        assert drum.get("fault") == Fault.POSITION_WIRE
        assert drum.state is State.FAULT_OFF
        assert drum.force_g == 0


def an_open_upper_switch_gives_no_zero_after_a_restart(image: str) -> None:
    """The board restarts in contact, and knows no zero that would contradict the switch."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        drum.pin(Input.END_UP, 1)
        drum.chip.reset(ResetBy.PIN)
        drum.run(250)
        assert drum.force_g > 0.8 * SET_FORCE_G
        assert drum.command(Command.TARE) != 0
        assert drum.command(Command.ARM) == 0
        drum.poll_for(8000)
        assert drum.get("fault") == Fault.POSITION_WIRE
        assert drum.state is State.FAULT_OFF
        assert drum.force_g == 0
        assert max(drum.forces) < 1.1 * SET_FORCE_G


def a_dead_cell_in_hold_ends_the_push(image: str) -> None:
    """The excitation breaks: the amplifier sends a noisy zero."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        drum.cell_is_dead = True
        drum.poll_for(4000)
        assert drum.get("fault") == Fault.FORCE_MISSING
        assert drum.force_g == 0
        assert max(drum.forces) < SET_FORCE_G + STIFFNESS_G_MM * (STILL_MM + LATE_MM)


def a_dead_cell_in_an_approach_ends_near_the_last_contact(image: str) -> None:
    """The excitation breaks while the drum is lifted."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        assert drum.command(Command.RETRACT, 5000) == 0
        drum.cell_is_dead = True
        assert drum.command(Command.APPROACH) == 0
        drum.poll_for(9000)
        assert drum.get("fault") == Fault.TOO_DEEP
        assert drum.force_g == 0
        assert max(drum.forces) < STIFFNESS_G_MM * (BEYOND_MM + LATE_MM)


def a_dead_cell_after_a_reset_ends_near_the_kept_contact(image: str) -> None:
    """The excitation breaks while the board is off; it has never felt this cell."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        assert drum.command(Command.RETRACT, 5000) == 0
        drum.cell_is_dead = True
        drum.chip.reset(ResetBy.PIN)
        drum.run(250)
        drum.arm()
        assert drum.command(Command.APPROACH) == 0
        drum.poll_for(12_000)
        assert drum.get("fault") == Fault.TOO_DEEP
        assert drum.force_g == 0
        assert max(drum.forces) < STIFFNESS_G_MM * (BEYOND_MM + KEPT_MM + LATE_MM)


def the_setup_presses_after_a_finger_only(image: str) -> None:
    """A reset forgets the finger."""
    with DrumChip(image) as drum:
        for fingers_g in ((), (300.0, 0.0), ()):
            drum.run(300)
            for finger_g in fingers_g:
                drum.finger_g = finger_g
                drum.run(300)
            assert drum.command(Command.ARM, 8000) == 0
            assert drum.command(Command.TARE, 8000) == 0
            assert drum.set("force_set", 1000) == 0
            refused = drum.command(Command.APPROACH_SETUP)
            assert refused == (0 if fingers_g else 4)
            drum.chip.reset(ResetBy.PIN)
            drum.run(300)


def an_uncommissioned_board_refuses_to_press(image: str) -> None:
    """It knows its wires by a hash in the EEPROM, which a reset and another image leave alone."""
    with DrumChip(image) as drum:
        assert drum.command(Command.ARM, 5000) == 0
        assert drum.command(Command.TARE, 8000) == 0
        assert drum.command(Command.APPROACH) == 4
        assert drum.command(Command.COMMISSION, 500) == 0
        assert drum.set("optional_signals", 30) == 0
        assert drum.command(Command.APPROACH) == 4
        assert drum.set("optional_signals", 31) == 0
        assert drum.command(Command.RETRACT, 8000) == 0
        assert drum.command(Command.APPROACH) == 0


WIRE_CONTROLS: tuple[tuple[str, str, Check], ...] = (
    ("swapped-unwatched", "direction not checked", a_swapped_actuator_presses_less_than_300_g),
    ("swapped-at-once", "the first motion is no ramp", a_swapped_actuator_presses_less_than_300_g),
    ("position-believed", "every reading is a place", a_broken_potentiometer_is_never_the_top),
    (
        "switch-believed",
        "the upper switch is believed in contact",
        an_open_upper_switch_is_not_the_top_in_contact,
    ),
    (
        "switch-alone",
        "the upper switch needs no other wire after a restart",
        an_open_upper_switch_gives_no_zero_after_a_restart,
    ),
    ("blind-push", "force need not follow motion", a_dead_cell_in_hold_ends_the_push),
    (
        "bottomless",
        "no bound by the last contact",
        a_dead_cell_in_an_approach_ends_near_the_last_contact,
    ),
    (
        "forgetful",
        "each boot forgets the contact",
        a_dead_cell_after_a_reset_ends_near_the_kept_contact,
    ),
    ("unfelt", "a cell that felt nothing is believed", the_setup_presses_after_a_finger_only),
    ("always-commissioned", "any board presses", an_uncommissioned_board_refuses_to_press),
)
"""Broken image, what is broken in it, and the check that must fail on it."""
