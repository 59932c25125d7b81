"""Checks that writes of a computer cannot make an image of the drum press too hard.

The bench's true force decides. Each check passes on the flashed image, and fails on an image
without the tested rule (:data:`ATTACK_CONTROLS`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rigctl.bench.chips.simavr import Input, ResetBy
from rigctl.boards.drum_codes import Command, ForceMode, Status
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.checks import SET_FORCE_G, Check
from tests.firmware.drum.support.chip import STIFFNESS_G_MM, DrumChip
from tests.firmware.drum.support.overshoot import linear, overshoot_g

OUT_OF_RANGE, REFUSED = 3, 4
LIFT_LIMIT_MS = 9000
IMPOSSIBLE_SCALES = (0, 1, -1, 199, -199, 25_001, 1_000_000)


def has_status(drum: DrumChip, status: Status) -> bool:
    """Return a bit of the board's status."""
    return bool(drum.get("status_bits") >> status & 1)


def limit_g(drum: DrumChip) -> float:
    """Return the highest true force that any write may cause on this bench."""
    most = float(drum.get("most_force"))
    return most + overshoot_g(drum.get("overrun_um"), most, linear(STIFFNESS_G_MM))


@contextmanager
def holding_drum(image: str) -> Iterator[DrumChip]:
    """Yield a drum in HOLD at 500 g."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        yield drum


def force_changing_writes(drum: DrumChip) -> list[dict[str, int]]:
    """Return writes that would change the zero, scale or limit of the force by 1 to 20 kg."""
    pressed = drum.get("loadcell_recent")
    return [
        {"scale_ug_per_count": 240},
        {"scale_ug_per_count": 1200},
        {"tare_counts": pressed},
        {"tare_place_00": 30_000},
        {"over_force": 30_000},
        {"depth_set_um": 10_000},
        {"force_mode": ForceMode.POSITION},
        {"signal_polarity": 12},
        {"optional_signals": 0},
    ]


def settings_of_the_force_are_locked_in_hold(image: str) -> None:
    """HOLD refuses every such write and keeps its force; it accepts an unchanged value."""
    with holding_drum(image) as drum:
        for writes in force_changing_writes(drum):
            for name, value in writes.items():
                before = drum.get(name)
                assert drum.set(name, value) == REFUSED, name
                assert drum.get(name) == before
                assert drum.set(name, before) == 0
            drum.poll_for(200)
        assert drum.state is State.HOLD
        assert max(drum.forces) < 1.1 * SET_FORCE_G


def no_impossible_scale_is_accepted(image: str) -> None:
    """No state accepts one; a negative scale, of a cell mounted upside down, is possible."""
    with DrumChip(image) as drum:
        for scale in IMPOSSIBLE_SCALES:
            assert drum.set("scale_ug_per_count", scale) == OUT_OF_RANGE
        assert drum.set("scale_ug_per_count", -2400) == 0
        assert drum.set("scale_ug_per_count", 2400) == 0
        drum.arm()
        drum.hold(SET_FORCE_G)
        for scale in IMPOSSIBLE_SCALES:
            assert drum.set("scale_ug_per_count", scale) == OUT_OF_RANGE
        assert drum.state is State.HOLD


def a_wrong_scale_is_stopped_by_the_compiled_limit(image: str) -> None:
    """The scale is set while lifted, which is permitted; 1,500 g on it would be 18 kg."""
    with DrumChip(image) as drum:
        drum.arm()
        assert drum.set("scale_ug_per_count", 200) == 0
        assert drum.set("over_force", 30_000) == 0
        assert drum.set("force_set", 15_000) == 0
        assert drum.command(Command.COMMISSION, 500) == 0
        assert drum.command(Command.APPROACH) == 0
        drum.poll_for(9000)
        assert max(drum.forces) <= limit_g(drum)
        assert drum.get("fault") == Fault.OVER_FORCE
        assert drum.force_g == 0


def a_depth_is_stopped_by_the_compiled_limit(image: str) -> None:
    """10 mm into the skin would be 6 kg."""
    with DrumChip(image) as drum:
        drum.arm()
        assert drum.set("over_force", 30_000) == 0
        assert drum.set("force_mode", ForceMode.POSITION) == 0
        assert drum.set("depth_set_um", 10_000) == 0
        assert drum.command(Command.APPROACH) == 0
        drum.poll_for(9000)
        assert max(drum.forces) <= limit_g(drum)
        assert drum.get("fault") == Fault.OVER_FORCE
        assert drum.force_g == 0


def a_pressed_emergency_stop_cannot_be_configured_away(image: str) -> None:
    """It is pressed in HOLD, and then also at boot."""
    for at_boot in (False, True):
        with holding_drum(image) as drum:
            drum.pin(Input.ESTOP, 1)
            drum.run(3)
            if at_boot:
                drum.chip.reset(ResetBy.PIN)
                drum.run(200)
            for name, value in (("signal_polarity", 1), ("optional_signals", 30)):
                assert drum.set(name, value) == REFUSED
            for command in (Command.DEFAULTS, Command.CLEAR, Command.ARM):
                assert drum.command(command) == REFUSED
            assert drum.state is State.FAULT_OFF
            assert drum.x.drive == 0


def a_tare_in_contact_is_refused(image: str) -> None:
    """After HOLD, emergency stop and CLEAR the drum still presses, and the board knows it."""
    with holding_drum(image) as drum:
        drum.pin(Input.ESTOP, 1)
        drum.poll_for(200)
        drum.pin(Input.ESTOP, 0)
        drum.run(3)
        assert drum.command(Command.CLEAR) == 0
        assert drum.force_g > 0.8 * SET_FORCE_G
        assert has_status(drum, Status.CONTACT_MAY_STAND)
        before = drum.get("tare_counts")
        assert drum.command(Command.TARE) == REFUSED
        assert drum.get("tare_counts") == before
        assert drum.command(Command.ARM, LIFT_LIMIT_MS) == 0
        assert drum.force_g == 0
        assert not has_status(drum, Status.CONTACT_MAY_STAND)
        drum.hold(SET_FORCE_G)
        assert max(drum.forces) < 1.1 * SET_FORCE_G


def a_lift_continues_until_contact_is_gone(image: str) -> None:
    """A slowed actuator lifts 1.3 mm of the 1.7 mm in 700 ms."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(1000)
        drum.actuator_mm_s = 2.0
        drum.run(1000)
        for _ in range(LIFT_LIMIT_MS // 100):
            drum.run(100)
            if drum.state is State.FAULT_OFF:
                break
        assert drum.state is State.FAULT_OFF
        assert drum.force_g == 0
        assert not has_status(drum, Status.LIFT_FAILED)
        assert not has_status(drum, Status.CONTACT_MAY_STAND)


ATTACK_CONTROLS: tuple[tuple[str, str, Check], ...] = (
    ("unguarded", "settings change in any state", settings_of_the_force_are_locked_in_hold),
    ("any-scale", "any scale is accepted", no_impossible_scale_is_accepted),
    ("no-raw-limit", "no limit in raw counts", a_wrong_scale_is_stopped_by_the_compiled_limit),
    ("no-raw-limit", "no limit in raw counts", a_depth_is_stopped_by_the_compiled_limit),
    (
        "estop-configurable",
        "signal settings change while the emergency stop is open",
        a_pressed_emergency_stop_cannot_be_configured_away,
    ),
    ("tare-in-contact", "any tare is accepted", a_tare_in_contact_is_refused),
    ("short-lift", "a fault lifts for 700 ms", a_lift_continues_until_contact_is_gone),
)
"""Broken image, what is broken in it, and the check that must fail on it."""
