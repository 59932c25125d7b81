"""What no computer may talk the drum's image into, as checks that take an image.

Judged by the bench's own true force. Each check passes on the image that is flashed, and fails on
the image without the rule that it is about (:data:`ATTACK_CONTROLS`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rigctl.simulation.chips.simavr import Input, ResetBy
from rigctl.wire.drum.codes import Command, ForceMode, Status
from rigctl.wire.drum.states import Fault, State
from tests.firmware.drum.support.checks import IMAGE, SET_FORCE_G, Check
from tests.firmware.drum.support.chip import STIFFNESS_G_MM, DrumChip
from tests.firmware.drum.support.overshoot import linear, overshoot_g

OUT_OF_RANGE, REFUSED = 3, 4
LIFT_LIMIT_MS = 9000
IMPOSSIBLE_SCALES = (0, 1, -1, 199, -199, 25_001, 1_000_000)


def shows(drum: DrumChip, status: Status) -> bool:
    """A bit of the board's status."""
    return bool(drum.get("status_bits") >> status & 1)


def limit_g(drum: DrumChip) -> float:
    """True force that the board may let come about on this bench, whatever is written."""
    most = float(drum.get("most_force"))
    return most + overshoot_g(drum.get("overrun_um"), most, linear(STIFFNESS_G_MM))


@contextmanager
def held(image: str) -> Iterator[DrumChip]:
    """A drum in HOLD at 500 g."""
    with DrumChip(image) as drum:
        drum.arm()
        drum.hold(SET_FORCE_G)
        yield drum


def attacks(drum: DrumChip) -> list[dict[str, int]]:
    """Writes that change what a force means, or what stops it; each was 1 to 20 kg once."""
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


def nothing_changes_what_a_held_force_means(image: str) -> None:
    """Every such write is refused in HOLD, and the force stays; its own value is taken."""
    with held(image) as drum:
        for writes in attacks(drum):
            for name, value in writes.items():
                before = drum.get(name)
                assert drum.set(name, value) == REFUSED, name
                assert drum.get(name) == before
                assert drum.set(name, before) == 0
            drum.poll_for(200)
        assert drum.state is State.HOLD
        assert max(drum.forces) < 1.1 * SET_FORCE_G


def no_impossible_scale_is_accepted(image: str) -> None:
    """In no state; a cell that is mounted upside down is possible."""
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


def a_wrong_scale_ends_at_the_boards_own_limit(image: str) -> None:
    """Set while lifted, as a person may; 1,500 g by its reading would be 18 kg."""
    with DrumChip(image) as drum:
        drum.arm()
        assert drum.set("scale_ug_per_count", 200) == 0
        assert drum.set("over_force", 30_000) == 0
        assert drum.set("force_set", 15_000) == 0
        assert drum.command(Command.APPROACH) == 0
        drum.poll_for(9000)
        assert max(drum.forces) <= limit_g(drum)
        assert drum.get("fault") == Fault.OVER_FORCE
        assert drum.force_g == 0


def a_depth_ends_at_the_boards_own_limit(image: str) -> None:
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


def a_held_emergency_stop_is_not_configured_away(image: str) -> None:
    """Pressed in HOLD, and pressed when the board starts."""
    for at_boot in (False, True):
        with held(image) as drum:
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
    """HOLD, emergency stop, released, CLEAR, TARE: the drum still presses, and the board knows."""
    with held(image) as drum:
        drum.pin(Input.ESTOP, 1)
        drum.poll_for(200)
        drum.pin(Input.ESTOP, 0)
        drum.run(3)
        assert drum.command(Command.CLEAR) == 0
        assert drum.force_g > 0.8 * SET_FORCE_G
        assert shows(drum, Status.CONTACT_MAY_STAND)
        before = drum.get("tare_counts")
        assert drum.command(Command.TARE) == REFUSED
        assert drum.get("tare_counts") == before
        assert drum.command(Command.ARM, LIFT_LIMIT_MS) == 0
        assert drum.force_g == 0
        assert not shows(drum, Status.CONTACT_MAY_STAND)
        drum.hold(SET_FORCE_G)
        assert max(drum.forces) < 1.1 * SET_FORCE_G


def a_lift_continues_until_contact_is_gone(image: str) -> None:
    """An actuator that has become slow lifts 1.3 mm in 700 ms, out of 1.7 mm."""
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
        assert not shows(drum, Status.LIFT_FAILED)
        assert not shows(drum, Status.CONTACT_MAY_STAND)


ATTACK_CHECKS: tuple[tuple[Check, str], ...] = tuple(
    (check, IMAGE)
    for check in (
        nothing_changes_what_a_held_force_means,
        no_impossible_scale_is_accepted,
        a_wrong_scale_ends_at_the_boards_own_limit,
        a_depth_ends_at_the_boards_own_limit,
        a_held_emergency_stop_is_not_configured_away,
        a_tare_in_contact_is_refused,
        a_lift_continues_until_contact_is_gone,
    )
)
"""Each check, and the good image that it passes on."""

ATTACK_CONTROLS: tuple[tuple[str, str, Check], ...] = (
    ("unguarded", "settings change in any state", nothing_changes_what_a_held_force_means),
    ("any-scale", "any scale is accepted", no_impossible_scale_is_accepted),
    ("no-raw-limit", "no limit in raw counts", a_wrong_scale_ends_at_the_boards_own_limit),
    ("no-raw-limit", "no limit in raw counts", a_depth_ends_at_the_boards_own_limit),
    (
        "estop-configurable",
        "signal settings change while the emergency stop is open",
        a_held_emergency_stop_is_not_configured_away,
    ),
    ("tare-in-contact", "any tare is accepted", a_tare_in_contact_is_refused),
    ("short-lift", "a fault lifts for 700 ms", a_lift_continues_until_contact_is_gone),
)
"""Broken image, what is broken in it, and the check that must fail on it."""
