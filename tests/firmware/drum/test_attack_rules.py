"""No write of a computer makes the drum press too hard; each rule is needed for that."""

from __future__ import annotations

import pytest

from rigctl.bench.chips.simavr import Input, ResetBy
from rigctl.bench.contact import ForceTable, contact_tables, draw_mounting, force_table
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.attacks import (
    LIFT_LIMIT_MS,
    REFUSED,
    has_status,
    holding_drum,
)
from tests.firmware.drum.support.checks import IMAGE
from tests.firmware.drum.support.chip import DrumChip
from tests.firmware.drum.support.overshoot import overshoot_g

STIFFEST = WorldParameters(stiffness_g_mm=900.0, pressure_power=2.2, frame_share=0.3)
"""Skin and frame at the end of the plausible range."""


def plates(bench: WorldParameters) -> list[ForceTable]:
    """Return the contacts of the smooth plate and of those with the highest and widest ridges."""
    seat = draw_mounting(bench, 1, 0)
    return [force_table(contact_tables(plate, bench), bench, seat) for plate in "ACD"]


def test_the_board_reports_its_force_limit_and_its_overrun() -> None:
    with DrumChip() as drum:
        most, overrun_um = drum.get("most_force"), drum.get("overrun_um")
    assert most == 2000
    assert overrun_um == pytest.approx(10 * (12.5 + 6 + 1 + 30), abs=1)  # mm/s × ms
    nominal, stiffest = (
        max(overshoot_g(overrun_um, most, pressed) for pressed in plates(bench))
        for bench in (WorldParameters(), STIFFEST)
    )
    print(f"beyond {most} g: {nominal:.0f} g nominal, {stiffest:.0f} g on the stiffest skin")
    assert nominal < stiffest < 0.5 * most


def test_a_lift_of_a_stuck_actuator_ends_and_is_reported() -> None:
    with holding_drum(IMAGE) as drum:
        drum.actuator_mm_s = 0.0
        drum.run(LIFT_LIMIT_MS)
        assert drum.state is State.FAULT_OFF
        assert drum.x.drive == 0
        assert drum.get("fault") == Fault.ACTUATOR_STUCK, "a missed heartbeat hides no other cause"
        assert has_status(drum, Status.LIFT_FAILED)
        assert has_status(drum, Status.CONTACT_MAY_STAND)
        drum.actuator_mm_s = 10.0
        drum.beat()
        assert drum.command(Command.CLEAR) == 0
        assert has_status(drum, Status.CONTACT_MAY_STAND)
        assert drum.command(Command.ARM, LIFT_LIMIT_MS) == 0
        assert drum.force_g == 0
        assert not has_status(drum, Status.LIFT_FAILED)


def test_a_board_that_boots_in_contact_lifts_before_it_is_tared() -> None:
    with holding_drum(IMAGE) as drum:
        drum.chip.reset(ResetBy.PIN)
        drum.run(200)
        assert drum.state is State.IDLE
        assert drum.force_g > 400
        assert has_status(drum, Status.CONTACT_MAY_STAND)
        assert drum.command(Command.TARE) == REFUSED
        assert drum.command(Command.TARE_TURN) == REFUSED
        assert drum.set("tare_counts", 288_000) == REFUSED
        drum.arm()
        drum.hold(500)
        assert max(drum.forces) < 550


def test_a_normally_open_emergency_stop_can_be_compiled_in() -> None:
    with DrumChip("firmware/drum-normally-open.elf") as drum:
        drum.pin(Input.ESTOP, 1)
        drum.run(2)
        drum.chip.reset(ResetBy.PIN)
        drum.run(200)
        assert drum.get("signal_polarity") == 1
        drum.arm()
        drum.pin(Input.ESTOP, 0)
        drum.run(3)
        assert drum.get("fault") == Fault.ESTOP
        assert drum.set("signal_polarity", 0) == REFUSED


def test_a_normally_open_emergency_stop_is_configured_while_it_is_pressed() -> None:
    """The new polarity reads an unpressed normally open switch as pressed."""
    with DrumChip() as drum:
        assert drum.set("signal_polarity", 1) == 0
        drum.run(3)
        assert drum.get("fault") == Fault.ESTOP
        drum.pin(Input.ESTOP, 1)
        drum.run(3)
        assert drum.command(Command.CLEAR) == 0
        drum.arm()
        drum.pin(Input.ESTOP, 0)
        drum.run(3)
        assert drum.state is State.FAULT_OFF


def test_a_refused_block_changes_none_of_its_settings() -> None:
    with holding_drum(IMAGE) as drum:
        place = BY_NAME["over_force"].address
        clearance = drum.get("lift_clearance_um")
        assert drum.write(place, 20_000, 777) == REFUSED
        assert drum.get("lift_clearance_um") == clearance
        assert drum.write(place, 14_000, 777) == 0
        assert drum.get("lift_clearance_um") == 777
