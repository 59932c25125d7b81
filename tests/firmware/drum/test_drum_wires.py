"""Wrong and broken wires of actuator, potentiometer and load cell, on the compiled image."""

from __future__ import annotations

import pytest

from rigctl.bench.chips.simavr import ResetBy
from rigctl.boards.drum_codes import Command, Status
from tests.firmware.drum.support.attacks import has_status
from tests.firmware.drum.support.checks import Check
from tests.firmware.drum.support.chip import DrumChip
from tests.firmware.drum.support.wires import WIRE_CHECKS, WIRE_CONTROLS


def _name(value: object) -> str:
    return getattr(value, "__name__", str(value))


@pytest.mark.parametrize(("check", "image"), WIRE_CHECKS, ids=_name)
def test_the_image_passes(check: Check, image: str) -> None:
    check(image)


@pytest.mark.parametrize(("broken", "_what", "check"), WIRE_CONTROLS, ids=_name)
def test_the_broken_image_fails(broken: str, _what: str, check: Check) -> None:
    with pytest.raises(AssertionError):
        check(f"firmware/drum-{broken}.elf")


def test_every_check_has_a_control() -> None:
    assert {check for check, _ in WIRE_CHECKS} == {check for *_, check in WIRE_CONTROLS}


def test_a_commission_outlives_a_reset_and_ends_with_its_settings() -> None:
    with DrumChip() as drum:
        assert not has_status(drum, Status.COMMISSIONED)
        assert drum.command(Command.COMMISSION, 500) == 0
        hash_before = drum.get("settings_hash")
        drum.chip.reset(ResetBy.PIN)
        drum.run(150)
        assert has_status(drum, Status.COMMISSIONED)
        assert drum.set("scale_ug_per_count", 2500) == 0
        assert drum.get("settings_hash") != hash_before
        assert not has_status(drum, Status.COMMISSIONED)


def test_a_nudge_moves_a_little_and_reports_its_way() -> None:
    with DrumChip() as drum:
        for direction, sign in ((1, 1), (0, -1)):
            begun_mm = drum.rod_mm
            assert drum.set("nudge_direction", direction) == 0
            assert drum.command(Command.NUDGE, 3000) == 0
            assert 80 <= sign * drum.get("nudge_travel_um") <= 150
            assert abs(drum.rod_mm - begun_mm) < 0.3
            assert has_status(drum, Status.DIRECTION_KNOWN)
