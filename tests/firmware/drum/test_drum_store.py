"""Settings in the drum's EEPROM are complete, either old or new, after any loss of power."""

from __future__ import annotations

import pytest

from rigctl.bench.chips.simavr import ResetBy
from rigctl.boards.drum_codes import Command, SettingsFrom
from tests.firmware.drum.support.chip import MS, DrumChip

SLOTS, STRIDE, SLOT_BYTES = 64, 128, 2 + 2 * 49 + 2
OLD, NEW = (3000, 30), (4000, 40)
"""Values of ``force_set`` and of the last saved register, a tare place."""


def write(drum: DrumChip, values: tuple[int, int]) -> None:
    assert drum.set("force_set", values[0]) == 0
    assert drum.set("tare_place_15", values[1]) == 0


def read(drum: DrumChip) -> tuple[int, int]:
    return drum.get("force_set"), drum.get("tare_place_15")


def lift(drum: DrumChip) -> None:
    """Move to the upper end, where the board accepts a tare."""
    drum.rod_mm = 0.0
    drum.run(50)


def power_cycle(drum: DrumChip) -> None:
    drum.chip.reset(ResetBy.POWER)
    drum.run(250)


def save(drum: DrumChip, values: tuple[int, int]) -> None:
    write(drum, values)
    assert drum.command(Command.SAVE, 1000) == 0


def test_a_save_writes_at_most_one_byte_per_tick() -> None:
    with DrumChip() as drum:
        lift(drum)
        begun = drum.x.cycle // MS
        save(drum, OLD)
        assert drum.x.cycle // MS - begun >= SLOT_BYTES
        power_cycle(drum)
        assert read(drum) == OLD
        assert drum.get("settings_from") == SettingsFrom.SAVED


def test_power_loss_at_any_byte_leaves_complete_old_or_new_settings() -> None:
    with DrumChip() as drum:
        lift(drum)
        save(drum, (1000, 10))
        save(drum, OLD)
        kept = drum.chip.read_eeprom(SLOTS, 2 * STRIDE)
        found = []
        for milliseconds in range(0, SLOT_BYTES + 12, 2):
            drum.chip.write_eeprom(SLOTS, kept)
            power_cycle(drum)
            write(drum, NEW)
            assert drum.command(Command.SAVE) == 0
            drum.run(milliseconds)
            power_cycle(drum)
            found.append(read(drum))
        assert set(found) == {OLD, NEW}
        assert found == sorted(found)


@pytest.mark.parametrize("byte", [0, 1, 2, 50, SLOT_BYTES - 3, SLOT_BYTES - 2, SLOT_BYTES - 1])
def test_a_damaged_slot_falls_back_to_the_other_and_then_to_defaults(byte: int) -> None:
    with DrumChip() as drum:
        lift(drum)
        save(drum, OLD)
        save(drum, NEW)
        for start, expected in ((SLOTS + STRIDE, OLD), (SLOTS, (5000, 0))):
            (old,) = drum.chip.read_eeprom(start + byte, 1)
            drum.chip.write_eeprom(start + byte, bytes([old ^ 0x10]))
            power_cycle(drum)
            assert read(drum) == expected
        assert drum.get("settings_from") == SettingsFrom.DAMAGED
        assert drum.command(Command.SAVE, 1000) == 0
        power_cycle(drum)
        assert drum.get("settings_from") == SettingsFrom.SAVED


def test_a_blank_board_reports_its_default_settings() -> None:
    with DrumChip() as drum:
        assert drum.get("settings_from") == SettingsFrom.DEFAULTS
